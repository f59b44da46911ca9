"""The worlds: what is explored, where each begins, what it abstracts and where it hands over to another."""

from __future__ import annotations

from itertools import combinations
from typing import Dict, Tuple

from proof_moves import WRONG, Move, World
from proof_peers import UNCOUNTED, UNIT, UNNAMED, limited

from amaze_autonomy.engine.state import State

Script = Tuple[Move, ...]


def script(text: str) -> Script:
    """Return the moves of a text."""
    return tuple(tuple(part.split(":")) for part in text.split())


_BOOT = "start vehicle:ground beat"
_SELECTED = f"{_BOOT} select:one"
_CHECKED = f"{_SELECTED} checks:ok"
_RECORDING = f"{_CHECKED} reply:recording:ACCEPTED recorder:RECORDING"
_LOADING = f"{_RECORDING} beat"
_LOADED = f"{_LOADING} checks:ok reply:load:ACCEPTED"
_ARMING = f"{_LOADED} planner:LOADED"
_CLIMBING = f"{_ARMING} reply:motion:ACCEPTED beat planner:TAKING_OFF vehicle:armed detection:AIRBORNE vehicle:lifting"
_FLYING = f"{_CLIMBING} planner:FLYING vehicle:flying"
_TWO = _FLYING.replace("select:one", "select:two")
_TOUCHDOWN = f"{_TWO} planner:LANDING vehicle:landing detection:ON_GROUND vehicle:ground wait planner:LANDED!"
_LANDING = f"{_FLYING} user:land"
_MISSION_OF_TWO = (
    f"{_FLYING} planner:LANDING vehicle:landing detection:ON_GROUND vehicle:ground wait planner:LANDED!".replace(
        "select:one", "select:one:some"
    )
)
_CLEANING = f"{_LANDING} vehicle:landing detection:ON_GROUND vehicle:ground wait"

SEEDS: Dict[str, Script] = {
    "boot": script(_BOOT),
    "selected": script(_SELECTED),
    "checked": script(_CHECKED),
    "loading": script(_LOADING),
    "loaded": script(_LOADED),
    "arming": script(_ARMING),
    "climbing": script(_CLIMBING),
    "flying": script(_FLYING),
    "touchdown": script(_TOUCHDOWN),
    "landing": script(_LANDING),
    "cleaning": script(_CLEANING),
}

_OWN = _FLYING.replace("select:one", "select:own")
_ALARMED = f"{_FLYING} user:hold user:land wait wait wait wait"
_HOME = "vehicle:landing detection:ON_GROUND vehicle:ground wait wait recorder:COMPLETE"
_AGAIN = (
    "select:one checks:ok reply:recording:ACCEPTED recorder:RECORDING beat checks:ok reply:load:ACCEPTED "
    "planner:LOADED reply:motion:ACCEPTED beat planner:TAKING_OFF vehicle:armed detection:AIRBORNE vehicle:lifting "
    "planner:FLYING vehicle:flying"
)
_NEXT_FILE = (
    "planner:LANDING vehicle:landing detection:ON_GROUND vehicle:ground wait planner:LANDED! checks:ok "
    "reply:load:ACCEPTED planner:LOADED reply:motion:ACCEPTED beat planner:TAKING_OFF vehicle:armed "
    "detection:AIRBORNE vehicle:lifting planner:FLYING vehicle:flying"
)

_GROUNDED = (State.DATA_CLEANUP, State.OUTREACH, State.PREFLIGHT, State.MISSION_INPUT)
_STANDS = {"ground": ()}
_FLIES = {"flying": ("landing",), "landing": ("ground",), "ground": ()}
_ROWS: Dict[str, Tuple[Tuple[int, str], ...]] = {
    "gps": ((2, "none"),),
    "barometer": ((4, "none"),),
    "lrf": ((8, "trying"), (16, "given_up")),
    "imu": ((16, "none"),),
}
"""Each row of the decision table, and the codes that its components have when they fail."""


def _pair(one: str, other: str) -> World:
    return World(
        name=f"{one} and {other}",
        words="in flight, two components of different rows fail, come back and fail again in any order",
        seeds=(SEEDS["flying"],),
        scenes=_FLIES,
        planner=("FLYING", "HOLDING"),
        codes={one: _ROWS[one], other: _ROWS[other]},
        failing=2,
        motion=(),
        stop=_GROUNDED,
    )


_ALL: Tuple[World, ...] = (
    World(
        name="start",
        words="the engine starts, or is started anew, with a vehicle in any state; missions are selected",
        seeds=(script("start"), script("vehicle:ground start"), script("vehicle:flying start")),
        missions=(("one",), ("one", "two"), (WRONG,)),
        scenes={
            "ground": ("armed",),
            "armed": ("flying",),
            "flying": ("landing",),
            "landing": ("touched",),
            "touched": ("ground",),
        },
        anytime=("pilot", "failsafe", "unknown", "armed_landed?"),
        users=("acknowledge", "land", "go"),
        restart=True,
        shutdown=True,
        noise=True,
        stop=(State.PREFLIGHT, State.DATA_CLEANUP, State.MISSION_ENDED),
    ),
    World(
        name="checks",
        words="selection to Ready: answers, silence, fixes and rounds of two checks (the other three pass)",
        rules=limited(check_reply_limit_ns=3 * UNIT, check_max_age_ns=UNIT),
        seeds=(SEEDS["selected"],),
        missions=(("one",),),
        scenes=_STANDS,
        checks={
            "watchdog": ("ok", "lacks", "fixable", "fail", "timed_out"),
            "battery": ("ok", "unknown", "refused", "unavailable"),
        },
        users=("retry", "give_up"),
        restart=True,
        late=True,
        stop=(State.START_RECORDING,),
    ),
    World(
        name="ready",
        words="Ready with the operator's go: failures, silence, arming by others, the end of the process",
        seeds=(SEEDS["checked"],),
        rules=limited(require_go=True),
        missions=(("some",),),
        scenes={"ground": ("armed",), "armed": ("ground",)},
        codes={"lrf": ((8, "trying"),), "gps": ((2, "none"),)},
        silences=("watchdog", "loop"),
        users=("go", "retry", "give_up", "abort"),
        restart=True,
        shutdown=True,
        stop=(State.START_RECORDING, State.PILOT),
    ),
    World(
        name="mute watchdog",
        words="a watchdog that accepts its start and never beats, or only later; a clock that stands before takeoff",
        seeds=(script(_CHECKED.replace("start ", "start silence:watchdog ", 1)),),
        rules=limited(require_go=True),
        scenes=_STANDS,
        silences=("watchdog",),
        clocks=("1.5", "0.0"),
        users=("go", "retry"),
        restart=True,
        stop=(State.START_RECORDING,),
    ),
    World(
        name="recording",
        words="the recording starts, stalls, fails, is refused or is silent; the user gives up or tries again",
        seeds=(SEEDS["checked"],),
        missions=(("one",),),
        scenes=_STANDS,
        recorder=("STARTING", "RECORDING", "STALLED", "FAILED"),
        recording=("ACCEPTED", "REFUSED", "TIMED_OUT"),
        silences=("recorder",),
        users=("retry", "give_up"),
        restart=True,
        late=True,
        shutdown=True,
        stop=(State.LOAD_MISSION, State.DATA_CLEANUP),
    ),
    World(
        name="loading",
        words="the last checks before takeoff and the planner's word: answered, refused, silent, too old, out of "
        "order; or the process was told to end",
        rules=limited(load_limit_ns=3 * UNIT, check_max_age_ns=UNIT),
        seeds=(SEEDS["loading"], SEEDS["loaded"], script(_ARMING.replace("select", "shutdown select"))),
        scenes=_STANDS,
        checks={"watchdog": ("ok", "fail"), "battery": ("ok", "broken")},
        planner=("LOADED", "IDLE"),
        load=("ACCEPTED", "REFUSED", "TIMED_OUT"),
        users=("give_up",),
        restart=True,
        away=True,
        late=True,
        noise=True,
        stop=(State.TAKEOFF, State.PREFLIGHT, State.OUTREACH, State.DATA_CLEANUP, State.PILOT),
    ),
    World(
        name="away",
        words="an engine that was away for long, or was told to end and killed, before a takeoff: a person asks for it",
        seeds=(SEEDS["loaded"],),
        scenes=_STANDS,
        users=("retry",),
        restart=True,
        away=True,
        stop=(State.TAKEOFF,),
    ),
    World(
        name="unfit",
        words="whatever may be wrong in the moment of the takeoff: vehicle, battery, recorder, component, silence",
        rules=limited(load_limit_ns=3 * UNIT, check_max_age_ns=3 * UNIT),
        seeds=(SEEDS["loaded"],),
        scenes={"ground": ("armed",), "armed": ("ground",)},
        anytime=("unknown", "landed?"),
        batteries=("good", "unknown", "critical"),
        planner=("LOADED",),
        recorder=("RECORDING", "STALLED"),
        codes={"stranger": ((8, "trying"), (16, "none"))},
        silences=("watchdog", "autopilot", "recorder"),
        quiet=2,
        shutdown=True,
        stop=(State.TAKEOFF, State.PREFLIGHT, State.OUTREACH, State.DATA_CLEANUP, State.PILOT),
    ),
    World(
        name="not required",
        words="components that the mission does not require fail before its takeoff: flown without, or not flown",
        rules=limited(load_limit_ns=3 * UNIT, check_max_age_ns=3 * UNIT),
        seeds=(script(_LOADED.replace("select:one", "select:some")),),
        scenes=_STANDS,
        planner=("LOADED",),
        codes={"barometer": ((4, "none"), (16, "none")), "gps": ((2, "none"),), "stranger": ((8, "trying"),)},
        failing=2,
        stop=(State.TAKEOFF, State.PREFLIGHT, State.OUTREACH, State.DATA_CLEANUP, State.PILOT),
    ),
    World(
        name="takeoff",
        words="the takeoff command to takeoff height: a vehicle that arms, lifts off, drops back or does not say",
        seeds=(SEEDS["arming"],),
        scenes={
            "ground": ("armed",),
            "armed": ("ground", "lifting"),
            "lifting": ("flying", "touched"),
            "touched": ("ground",),
            "flying": (),
        },
        anytime=("unknown", "landed?", "pilot"),
        planner=("FAILED",),
        codes={"lrf": ((8, "trying"),), "imu": ((16, "none"),)},
        motion=("ACCEPTED", "REFUSED", "TIMED_OUT"),
        users=("abort",),
        restart=True,
        late=True,
        stop=(State.MISSION, State.HOLD, *_GROUNDED, State.PILOT),
    ),
    World(
        name="lift-off unsaid",
        words="it is armed, and whether it has left the ground is not said",
        seeds=(script(f"{_ARMING} reply:motion:ACCEPTED beat vehicle:armed"),),
        scenes={"armed": ("lifting",), "lifting": ("flying",), "flying": ()},
        anytime=("armed_landed?",),
        stop=(State.MISSION, State.HOLD, *_GROUNDED, State.PILOT),
    ),
    World(
        name="late arming",
        words="a takeoff that is called off before the vehicle shows that it is armed, and arms all the same",
        seeds=(script(f"{_ARMING} user:abort"), script(f"{_ARMING} user:land")),
        scenes={
            "ground": ("armed",),
            "armed": ("ground", "lifting"),
            "lifting": ("flying",),
            "flying": ("landing",),
            "landing": ("ground",),
        },
        anytime=("pilot",),
        motion=("ACCEPTED", "REFUSED"),
        users=("retry",),
        restart=True,
        stop=(State.READY, State.PILOT, State.MISSION_ENDED),
    ),
    *(
        World(
            name=f"flight with {name}",
            words=f"in flight, a component like {name} fails, comes back and fails again; the planner obeys or not",
            seeds=(SEEDS["climbing"], SEEDS["flying"]),
            scenes={
                "lifting": ("flying",),
                "flying": ("loitering", "landing"),
                "loitering": ("flying", "landing"),
                "landing": ("ground",),
                "ground": (),
            },
            planner=("FLYING", "HOLDING"),
            codes={name: codes},
            motion=("ACCEPTED", "REFUSED"),
            users=("hold", "resume") if name == "barometer" else (),
            restart=True,
            stop=_GROUNDED,
        )
        for name, codes in _ROWS.items()
    ),
    World(
        name="climb",
        words="a hold in the climb, by the user or for a component, and the climb resumed",
        seeds=(SEEDS["climbing"],),
        scenes={"lifting": ("flying",), "flying": ()},
        planner=("TAKING_OFF", "HOLDING"),
        codes={"lrf": ((8, "trying"),)},
        motion=("ACCEPTED", "REFUSED"),
        users=("hold", "resume"),
        stop=(State.LAND,),
    ),
    World(
        name="flapping",
        words="in flight, a component of row high or moderate fails and comes back until its budget is spent",
        seeds=(SEEDS["flying"],),
        scenes={"flying": ()},
        planner=("FLYING", "HOLDING"),
        codes={"lrf": ((8, "trying"),), "barometer": ((4, "none"),)},
        motion=(),
        stop=(State.LAND,),
    ),
    World(
        name="severities",
        words="in flight, every code of every row, of a component that nobody listed and of none that is named; the "
        "process is told to end",
        seeds=(SEEDS["flying"],),
        scenes=_FLIES,
        planner=("FLYING", "HOLDING"),
        codes={
            "gps": ((2, "given_up"), (4, "none"), (16, "none")),
            "barometer": ((4, "trying"), (4, "given_up"), (8, "given_up"), (16, "given_up")),
            "lrf": ((4, "none"), (4, "given_up"), (8, "given_up")),
            "imu": ((4, "none"), (8, "trying")),
            "stranger": ((4, "none"), (4, "given_up"), (8, "trying"), (8, "given_up"), (16, "none")),
            UNNAMED: ((4, "none"), (8, "none"), (16, "none")),
        },
        motion=("ACCEPTED",),
        shutdown=True,
        stop=_GROUNDED,
    ),
    *(_pair(one, other) for one, other in combinations(_ROWS, 2)),
    World(
        name="users",
        words="in flight, every command of the user at any moment, with a planner in any phase",
        seeds=(SEEDS["climbing"],),
        scenes={
            "lifting": ("flying",),
            "flying": ("landing",),
            "landing": ("touched",),
            "touched": ("ground",),
            "ground": (),
        },
        planner=("FLYING", "HOLDING", "LANDING", "LANDED!", "LANDED"),
        motion=("REFUSED",),
        users=("go", "retry", "give_up", "hold", "resume", "land", "abort", "acknowledge"),
        late=True,
        noise=True,
        stop=_GROUNDED,
    ),
    World(
        name="landing",
        words="landing, with a vehicle that contradicts itself in every way, and a landing detection that disagrees",
        seeds=(SEEDS["landing"],),
        scenes=dict.fromkeys(
            (
                "flying",
                "loitering",
                "sinking",
                "landing",
                "touched",
                "ground",
                "armed?",
                "landed?",
                "armed_landed?",
                "unknown",
                "disarmed_flying",
                "armed",
            ),
            (),
        ),
        anytime=(
            "flying",
            "landing",
            "touched",
            "ground",
            "armed?",
            "landed?",
            "armed_landed?",
            "unknown",
            "disarmed_flying",
            "sinking",
        ),
        detections=("ON_GROUND", "AIRBORNE"),
        motion=("REFUSED",),
        restart=True,
        stop=_GROUNDED,
    ),
    World(
        name="grounded",
        words="in its mission it is put down, armed, or stands in the air while the planner lands, and may fly on",
        seeds=(SEEDS["flying"],),
        scenes={
            "flying": ("put_down", "hovering"),
            "put_down": ("flying", "ground"),
            "hovering": ("landing", "flying"),
            "landing": ("touched",),
            "touched": ("ground",),
            "ground": (),
        },
        planner=("FLYING", "LANDING", "LANDED"),
        detections=("ON_GROUND", "AIRBORNE"),
        motion=(),
        stop=(*_GROUNDED, State.PILOT),
    ),
    World(
        name="silence",
        words="in flight, any two peers fall silent and return, the battery is low or unknown",
        seeds=(SEEDS["flying"],),
        scenes=_FLIES,
        batteries=("good", "unknown", "critical", "aged", "old"),
        planner=("FAILED",),
        silences=("watchdog", "loop", "planner", "autopilot", "recorder", "landing"),
        quiet=2,
        motion=(),
        stop=_GROUNDED,
    ),
    World(
        name="other clocks",
        words="in flight and while it lands, what a peer says is from long ago or from the future, and is of now again",
        seeds=(SEEDS["flying"], SEEDS["landing"]),
        scenes=_FLIES,
        silences=("old-autopilot", "early-autopilot", "old-watchdog", "old-planner", "early-recorder", "old-landing"),
        motion=(),
        restart=True,
        stop=_GROUNDED,
    ),
    World(
        name="limits",
        words="in flight, the limits of flight time, height, distance and tilt; a link, a position or the clock is "
        "lost",
        seeds=(SEEDS["climbing"],),
        rules=limited(max_flight_time_ns=5 * UNIT),
        scenes={"lifting": ("flying",), "flying": ("landing",), "landing": ("ground",), "ground": ()},
        anytime=(
            *("too_high", "too_far", "far_both_ways", "too_tilted", "leaning", "height_nan"),
            *("link_lost", "link_unknown", "flying"),
        ),
        clocks=("1.5", "0.0"),
        motion=(),
        planner=("FLYING",),
        restart=True,
        stop=_GROUNDED,
    ),
    World(
        name="lies",
        words="in flight, one status of the vehicle, planner, recorder or landing detection is wrong, and no other",
        seeds=(
            SEEDS["flying"],
            script(f"{_FLYING} user:hold vehicle:loitering planner:HOLDING beat"),
            SEEDS["landing"],
        ),
        scenes=_FLIES,
        planner=("FLYING", "HOLDING"),
        lies=(
            "autopilot=ground",
            "autopilot=touched",
            "autopilot=pilot",
            "autopilot=failsafe",
            "autopilot=foreign",
            "autopilot=landed?",
            "autopilot=disarmed_flying",
            "autopilot=unknown",
            "planner=IDLE",
            "planner=LOADED",
            "planner=HOLDING",
            "planner=LANDING",
            "planner=LANDED!",
            "recorder=FAILED",
            "recorder=COMPLETE",
            "recorder=STALLED",
            "landing=ON_GROUND",
            "landing=UNKNOWN",
            "battery=unknown",
            "battery=old",
        ),
        codes={"lrf": ((8, "trying"),)},
        users=("resume",),
        motion=(),
        stop=_GROUNDED,
    ),
    World(
        name="two at once",
        words="in flight, two facts in one event: pilot and loss, several failures, a user in the moment of a limit",
        seeds=(SEEDS["flying"], script(f"{_FLYING} component:lrf:8:trying vehicle:loitering planner:HOLDING beat")),
        scenes=_FLIES,
        anytime=("pilot_critical", "failsafe_lost", "high_critical", "flagged", "flagged_hold"),
        planner=("HOLDING",),
        at_once=(("imu=16", "lrf=8"), ("barometer=4", "lrf=8"), ("gps=4", "imu=4"), ("lrf=16", "stranger=8")),
        codes={"lrf": ((8, "given_up"),)},
        users_later=("hold", "resume", "land", "abort"),
        silences=("autopilot", "planner"),
        motion=("REFUSED",),
        shutdown=True,
        stop=_GROUNDED,
    ),
    World(
        name="own mission",
        words="a mission with severities, limits and tolerated components of its own, its second file and repetition",
        seeds=(script(_OWN), script(f"{_OWN} {_NEXT_FILE}"), script(f"{_OWN} {_NEXT_FILE} {_NEXT_FILE}")),
        rules=limited(max_flight_time_ns=6 * UNIT),
        scenes=_FLIES,
        anytime=("high_for_one", "far_for_one", "flying"),
        batteries=("aged",),
        planner=("FLYING", "HOLDING", "LANDED!"),
        codes={
            "gps": ((4, "none"),),
            "lrf": ((8, "trying"),),
            "imu": ((8, "none"),),
            "barometer": ((2, "none"), (4, "none")),
        },
        motion=(),
        stop=_GROUNDED,
    ),
    World(
        name="next flight",
        words="a second flight in one process, after one with a hold, both routes and an alarm: none of it is left",
        seeds=(script(f"{_ALARMED} {_HOME} {_AGAIN}"),),
        scenes={"flying": ("landing",), "landing": ("touched",), "touched": ("ground",), "ground": ()},
        planner=("HOLDING", "LANDED!"),
        codes={"imu": ((16, "none"),), "lrf": ((8, "trying"),)},
        silences=("autopilot",),
        users=("hold", "land"),
        restart=True,
        away=True,
        motion=(),
        stop=_GROUNDED,
    ),
    World(
        name="pilot",
        words="the pilot, a failsafe or a foreign flight mode takes over at any moment, and gives back",
        seeds=(SEEDS["arming"], SEEDS["flying"]),
        scenes={
            "ground": ("armed",),
            "armed": ("lifting",),
            "lifting": ("flying",),
            "flying": ("landing",),
            "landing": ("ground",),
        },
        anytime=("pilot", "failsafe", "foreign", "failsafe_landing"),
        planner=("FLYING",),
        codes={"lrf": ((8, "trying"), (16, "given_up"))},
        silences=("autopilot",),
        users=("land", "acknowledge", "hold"),
        motion=(),
        restart=True,
        stop=_GROUNDED,
    ),
    World(
        name="set-points",
        words="a takeoff by set-points, then a mission of the autopilot or one of set-points; either is somebody "
        "else's in a flight the other way; it is held, or climbs away, and goes on",
        seeds=(SEEDS["climbing"], script(_CLIMBING.replace("select:one", "select:points"))),
        scenes={
            "lifting": ("guided", "flying"),
            "guided": ("held", "rising", "flying", "loitering"),
            "held": ("guided", "rising", "flying", "loitering"),
            "rising": ("guided", "held"),
            "flying": ("guided", "loitering"),
            "loitering": ("guided", "flying"),
        },
        planner=("FLYING", "HOLDING"),
        codes={"lrf": ((8, "trying"),)},
        motion=(),
        stop=(State.LAND, *_GROUNDED),
    ),
    World(
        name="left alone",
        words="in somebody else's hands, or landed for in vain, the vehicle falls silent, for good or for a while; a "
        "person gives it up or not",
        seeds=(
            script(f"{_FLYING} vehicle:pilot wait"),
            script(f"{_LANDING} silence:autopilot wait wait wait wait"),
        ),
        scenes={"pilot": ("ground",), "ground": ("pilot",)},
        silences=("autopilot",),
        users=("acknowledge",),
        motion=(),
        restart=True,
        stop=_GROUNDED,
    ),
    World(
        name="led by nobody",
        words="the planner says that nothing is flown, or nothing is known of the vehicle for long, or what cannot "
        "be, while it flies",
        seeds=(SEEDS["flying"],),
        scenes=_FLIES,
        anytime=("unknown", "disarmed_flying"),
        planner=("FLYING", "LANDED", "IDLE", "LOADED"),
        users=("acknowledge", "hold"),
        motion=("ACCEPTED",),
        restart=True,
        stop=_GROUNDED,
    ),
    World(
        name="touchdown",
        words="on the ground between two files: checks, loading, failures, the next takeoff",
        seeds=(SEEDS["touchdown"],),
        scenes={"ground": ("armed",), "armed": ("ground",)},
        checks={"watchdog": ("ok", "fail")},
        planner=("LOADED", "IDLE"),
        load=("ACCEPTED", "REFUSED"),
        codes={"lrf": ((8, "trying"),)},
        recorder=("RECORDING", "STALLED"),
        users=("land", "give_up"),
        restart=True,
        shutdown=True,
        stop=(State.TAKEOFF, State.DATA_CLEANUP, State.PILOT),
    ),
    World(
        name="next file",
        words="a mission of two files: down, loaded, checked, up and down again",
        seeds=(script(_TWO),),
        scenes={"flying": ("ground",), "ground": ("armed",), "armed": ("lifting",), "lifting": ("flying",)},
        planner=("LOADED", "FLYING", "LANDED!"),
        motion=(),
        late=True,
        stop=_GROUNDED,
    ),
    World(
        name="last file",
        words="the end of a mission: the planner lands and says so, or not; armed or not; it may lift off again",
        seeds=(
            SEEDS["flying"],
            script(f"{_FLYING} planner:LANDING vehicle:landing detection:ON_GROUND vehicle:touched wait"),
        ),
        scenes={
            "flying": ("landing",),
            "landing": ("touched", "ground"),
            "touched": ("ground", "flying"),
            "ground": ("armed",),
            "armed": ("ground",),
        },
        anytime=("landed?",),
        detections=("ON_GROUND", "AIRBORNE"),
        planner=("LANDING", "LANDED", f"LANDED{UNCOUNTED}", "LANDED!"),
        codes={"lrf": ((8, "trying"),)},
        motion=(),
        restart=True,
        stop=_GROUNDED,
    ),
    World(
        name="data",
        words="the recording is stopped, collected, lacks a part, fails, is silent, retried, given up; next follows",
        seeds=(
            SEEDS["cleaning"],
            script(f"{_CLEANING} recorder:FAILED wait wait"),
            script(f"{_LOADED} user:land"),  # nothing was flown
        ),
        missions=(("one",),),
        scenes={"ground": ("armed",), "armed": ("ground",)},
        anytime=("landing",),
        recorder=("RECORDING", "STOPPING", "COMPLETE", "LOST", "FAILED"),
        recording=("ACCEPTED", "REFUSED"),
        silences=("recorder",),
        users=("retry", "give_up", "acknowledge"),
        restart=True,
        shutdown=True,
        noise=True,
        stop=(State.PREFLIGHT,),
    ),
    World(
        name="queue",
        words="several missions one after the other: complete goes on, anything else, or an absence, drops the rest",
        seeds=(script(_MISSION_OF_TWO),),
        scenes=_STANDS,
        recorder=("STOPPING", "COMPLETE", "FAILED"),
        users=("give_up", "retry"),
        shutdown=True,
        restart=True,
        away=True,
        stop=(State.START_RECORDING,),
    ),
)
WORLDS: Dict[str, World] = {world.name: world for world in _ALL}
