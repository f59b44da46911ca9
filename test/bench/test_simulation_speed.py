"""How fast missions fly in virtual time: world, engine and journal together. No wall time is asserted."""

import pytest

from amaze_autonomy import paths
from amaze_autonomy.config import load_configuration
from amaze_autonomy.engine.state import DataResult, Result
from amaze_autonomy.simulation.run import run


@pytest.mark.parametrize("mission_id", ["1", "4"], ids=["under a minute", "five minutes"])
def test_a_mission_in_virtual_time(benchmark, mission_id):
    configuration = load_configuration(paths.config_folder())
    mission = configuration.plan(mission_id).mission
    result = benchmark.pedantic(run, args=(configuration, (mission,)), rounds=3, warmup_rounds=1)
    assert result.results == ((mission_id, Result.COMPLETE, DataResult.COMPLETE),)
    benchmark.extra_info.update(simulated_s=result.state.t_ns / 1e9, journal_lines=len(result.lines))
