"""How fast a configuration is read, checked and hashed. No wall time is asserted."""

from amaze_autonomy import paths
from amaze_autonomy.config import load_configuration


def test_the_configuration_that_ships(benchmark):
    folder = paths.config_folder()
    assert benchmark(load_configuration, folder).hash == load_configuration(folder).hash
