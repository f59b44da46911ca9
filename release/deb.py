#!/usr/bin/env python3
"""What `./run deb` packs: catkin's install space, the Python environment that it runs in, and what apt must install.

The environment is a `venv` of the standard library, which names no place of its own: it can be made in one folder and
used in another. What pyproject.toml requires is copied into it from the environment that runs this, as it was tested
here; what belongs to a package of the system is a dependency instead. So packing needs no network.

usage: deb.py WORK OUTPUT "PACKAGE..." [OPTION...]
    pack WORK/root, where catkin has installed, with options of dpkg-deb; apt must install what is named
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Dict, Iterable, List, Optional
from xml.etree import ElementTree as ET

from pip._vendor.packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
NAME = "amaze-autonomy"
PREFIX = Path("/opt/amaze_autonomy")
"""Not /usr or /opt/ros: nothing of the vehicle's other software may import what is packed here by accident."""
COMMANDS = ("amaze-autonomy", "amaze-bag", "amaze-replay")
"""They go to /usr/bin; the nodes are found by roslaunch, after `source /opt/amaze_autonomy/setup.bash`."""
_MINOR = "{}.{}".format(*sys.version_info)
_NEXT_MINOR = f"{sys.version_info.major}.{sys.version_info.minor + 1}"


def required(name: str, extras: Iterable[str], found: Dict[str, Distribution]) -> Dict[str, Distribution]:
    """Add to what was found whatever a distribution requires here, what that requires, and so on; by their names."""
    for line in _installed(name).requires or ():
        requirement = Requirement(line)
        marker = requirement.marker
        key = re.sub(r"[-_.]+", "-", requirement.name).lower()
        if key not in found and (marker is None or any(marker.evaluate({"extra": each}) for each in ("", *extras))):
            found[key] = _installed(requirement.name)
            required(requirement.name, requirement.extras, found)
    return found


def _installed(name: str) -> Distribution:
    """Return a distribution by its name; Python 3.9 finds `ruamel.yaml` only as its folder is named, `ruamel_yaml`."""
    try:
        return distribution(name)
    except PackageNotFoundError:
        return distribution(re.sub(r"[-_.]+", "_", name))


def system_package(found: Distribution) -> Optional[str]:
    """Name the package of the system that a distribution belongs to."""
    asked = ["dpkg-query", "--search", str(found._path)]  # noqa: SLF001  (nothing public tells where it is)
    return subprocess.run(asked, capture_output=True, text=True, check=False).stdout.partition(":")[0] or None


def pin_interpreter(prefix: Path) -> None:
    """Have everything that names the interpreter of the build name the one that is packed."""
    for path in prefix.rglob("*"):
        data = path.read_bytes() if path.is_file() else b""
        if sys.executable.encode() in data:
            path.write_bytes(data.replace(sys.executable.encode(), bytes(PREFIX / "python/bin/python3")))


def make_environment(folder: Path) -> List[str]:
    """Make the environment; return the packages of the system that have what was not copied.

    Not in PREFIX/bin: setup.bash puts that in front of the PATH, where `env python3` of other packages would find it.
    """
    site = folder / "lib" / f"python{_MINOR}" / "site-packages"
    site.mkdir(parents=True)
    (folder / "bin").mkdir()
    (folder / "bin" / "python3").symlink_to(f"/usr/bin/python{_MINOR}")
    (folder / "pyvenv.cfg").write_text("home = /usr/bin\ninclude-system-site-packages = true\n")
    (site / "amaze_autonomy.pth").write_text("../../../../lib/python3/dist-packages\n")
    packages = []
    for found in required("amaze_autonomy", ["page"], {}).values():
        package = system_package(found)
        packages += [package] if package else []
        for file in () if package else found.files or ():
            if file.name != "RECORD" and not {"..", "__pycache__"} & {*file.parts}:  # nothing of elsewhere
                (site / file).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(found.locate_file(file), site / file)
    return packages


def compile_sources(root: Path) -> None:
    """Compile what users cannot: the folders are root's. Checked by content: dates in a package are not the files'."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPYCACHEPREFIX"}
    for folder in root.glob("opt/*/**/*-packages"):
        place = f"/{folder.relative_to(root)}"
        options = ["-q", "-q", "-f", "-j", "0", "-d", place, "--invalidation-mode", "checked-hash"]
        command = [sys.executable, "-m", "compileall", *options, str(folder)]
        subprocess.run(command, env=environment, check=False)  # some bring files for another Python


def control(depends: Iterable[str], installed_kib: int) -> Dict[str, str]:
    """Return the fields of the file of that name: what apt is told, of package.xml and of this system."""
    package = ET.parse(ROOT / "package.xml").getroot()
    system = dict(re.findall(r'^(\w+)="?([^"\n]*)', Path("/etc/os-release").read_text(), re.MULTILINE))
    architecture = subprocess.run(["dpkg", "--print-architecture"], capture_output=True, text=True, check=True).stdout
    maintainer = package.find("maintainer")
    synopsis, _, more = " ".join(package.findtext("description").split()).partition(": ")
    return {
        "Package": NAME,
        "Version": f"{package.findtext('version')}+{system['ID']}{system['VERSION_ID']}",
        "Architecture": architecture.strip(),
        "Maintainer": f"{maintainer.text} <{maintainer.get('email')}>",
        "Installed-Size": str(installed_kib),
        "Depends": ", ".join([f"python3 (>= {_MINOR})", f"python3 (<< {_NEXT_MINOR})", *sorted({*depends})]),
        "Section": "science",
        "Priority": "optional",
        "Description": f"{synopsis}\n {more[0].upper()}{more[1:]}\n For roslaunch: source {PREFIX}/setup.bash",
    }


def pack(work: Path, output: Path, packages: Iterable[str], options: Iterable[str]) -> Path:
    """Pack what catkin has installed below a folder's `root`; return the package."""
    root = work / "root"
    prefix = root / PREFIX.relative_to("/")
    pin_interpreter(prefix)
    needed = {*packages, *make_environment(prefix / "python")}
    compile_sources(root)
    (root / "usr/bin").mkdir(parents=True)
    for name in COMMANDS:
        (root / "usr/bin" / name).symlink_to(PREFIX / "lib/amaze_autonomy" / name)
    about = root / "usr/share/doc" / NAME
    about.mkdir(parents=True)
    shutil.copy(ROOT / "LICENSE", about / "copyright")
    files = sorted(path for path in root.rglob("*") if path.is_file() and not path.is_symlink())
    sums = [f"{hashlib.md5(path.read_bytes()).hexdigest()}  {path.relative_to(root)}\n" for path in files]  # noqa: S324
    fields = control(needed, sum(path.stat().st_size for path in files) // 1024)
    (root / "DEBIAN").mkdir()
    (root / "DEBIAN/md5sums").write_text("".join(sums))
    (root / "DEBIAN/control").write_text("".join(f"{name}: {value}\n" for name, value in fields.items()))
    subprocess.run(["chmod", "-R", "u=rwX,go=rX", str(root)], check=True)
    output.mkdir(parents=True, exist_ok=True)
    made = output / "{Package}_{Version}_{Architecture}.deb".format(**fields)
    command = ["dpkg-deb", "--root-owner-group", *options, "--build", str(root), str(made)]
    subprocess.run(command, stdout=sys.stderr, check=True)
    return made


if __name__ == "__main__":
    print(pack(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3].split(), sys.argv[4:]))
