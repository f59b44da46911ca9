"""Package for pip, catkin and colcon; metadata that needs no code is in pyproject.toml.

catkin on Noetic runs this file with a setuptools that does not read pyproject.toml, so name, version, packages and data
are given here. Temporary results go to a temporary folder: a build writes nothing into the source tree.
"""

import atexit
import shutil
import tempfile
from pathlib import Path
from xml.etree import ElementTree as ET

from setuptools import find_packages, setup

ROOT = Path(__file__).resolve().parent
SCRATCH = tempfile.mkdtemp(prefix="amaze_autonomy-")
atexit.register(shutil.rmtree, SCRATCH, ignore_errors=True)


def data_files():
    """Return config/ as data: it lands in <prefix>/share/amaze_autonomy/config, with pip and with catkin alike."""
    folders = {}
    for path in sorted((ROOT / "config").rglob("*")):
        if path.is_file():
            folder = "share/amaze_autonomy/" + path.parent.relative_to(ROOT).as_posix()
            folders.setdefault(folder, []).append(path.relative_to(ROOT).as_posix())
    return sorted(folders.items())


setup(
    name="amaze_autonomy",
    version=ET.parse(ROOT / "package.xml").getroot().findtext("version"),
    license="Apache-2.0",
    packages=find_packages("src"),
    package_dir={"": "src"},
    package_data={
        "": ["py.typed"],
        "amaze_autonomy.nodes.web": ["page/*"],
        "amaze_autonomy.replay": ["maps/*.yaml"],
        "amaze_autonomy.pages": ["*.html", "*.css", "*.js"],
    },
    data_files=data_files(),
    options={"build": {"build_base": SCRATCH}, "egg_info": {"egg_base": SCRATCH}},
)
