"""A scenario file: one repeatable run of the simulator, faults included."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from armd.files.schema import Strict
from armd.simulator.live.faults import Fault


class Scenario(Strict):
    """The keys of a scenario, `schema = "armd.scenario/1"`; options override them."""

    schema_: Literal["armd.scenario/1"] = Field(default="armd.scenario/1", alias="schema")
    seed: Annotated[int, Field(ge=0)] = 1
    rate_hz: Annotated[int, Field(ge=1, le=5000)] = 1000
    seconds: Annotated[float, Field(gt=0)] | None = None
    serial_number: Annotated[str, Field(min_length=1, max_length=16, pattern=r"^[!-~]+$")] = (
        "SIM-0001"
    )
    #: of the arm; None: six, or five for a servo arm
    joints: Annotated[int, Field(ge=3, le=9)] | None = None
    ambient_c: Annotated[float, Field(ge=-40, le=80)] = 20.0
    #: the links' mean rise within `warm_up_s` (default: `seconds`, else 20), in fast motion
    warm_up_k: Annotated[float, Field(gt=0, le=60)] | None = None
    warm_up_s: Annotated[float, Field(gt=0)] | None = None
    #: the device counter at the first boot, e.g. 4294967000 to see it wrap
    first_seq: Annotated[int, Field(ge=0, lt=1 << 32)] = 0
    clock_ppm: Annotated[float, Field(ge=-500, le=500)] = 35.0
    #: on CAN: the arm's own SYNC at `rate_hz`; otherwise the host produces it
    sync_producer: bool = False
    fault: list[Fault] = []
    #: random faults from the seed, besides those listed; wants `seconds`
    faults_per_minute: Annotated[float, Field(ge=0, le=60)] = 0.0
