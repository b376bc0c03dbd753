"""Schema of the space: a grid or a location graph, with attributes and detectors."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from merap.concerns.schema_base import (
    REF_SCHEMA,
    LocationRef,
    Name,
    Settings,
    Spec,
    is_cell,
    location_ref,
    shown,
    wrong,
)
from merap.concerns.schema_processes import ALWAYS, Draws, ProcessChangeSpec, ProcessSpec

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
MAX_SIDE = 1000


class GridSpec(Spec):
    """A rectangle of cells; locations are [row, col] from 0, rows grow downwards."""

    rows: int = Field(ge=1, le=MAX_SIDE, description="number of rows")
    cols: int = Field(ge=1, le=MAX_SIDE, description="number of columns")
    moves: dict[Name, tuple[int, int]] = Field(
        min_length=1, description="edge label: [rows down, columns right], as up: [-1, 0]"
    )


class AttributeSpec(Spec):
    """A value at every location that expressions can read."""

    type: Literal["bool", "int", "real"] | None = Field(
        default=None, description="left out: int if both ends of the range are whole, else real"
    )
    range: tuple[float, float] | None = Field(
        default=None, description="[least, greatest] value allowed, left out: any; not for bool"
    )
    default: bool | float | None = Field(default=None, description="value where none is given; bool: false")
    values: Settings = Field(
        default=(), description="mapping of location to value, or list of entries with at and value"
    )

    @model_validator(mode="before")
    @classmethod
    def _integral_range(cls, data: Any) -> Any:
        bounds = data.get("range") if isinstance(data, dict) else None
        if isinstance(bounds, tuple) and "type" not in data:
            whole = all(isinstance(bound, int) and not isinstance(bound, bool) for bound in bounds)
            return {**data, "type": "int" if whole else "real"}
        return data

    @model_validator(mode="after")
    def _consistent(self) -> AttributeSpec:
        if self.type == "bool":
            if self.range is not None:
                raise wrong("an attribute of type bool has no range", ("range",))
        elif self.range is None:
            if self.type is None:
                raise wrong("give range: [least, greatest], or type: bool, int or real")
        elif self.range[0] > self.range[1]:
            raise wrong(f"expected [least, greatest], got {list(self.range)}", ("range",))
        return self


class DetectorSpec(Spec):
    """A sensor that reads the own location and nearby ones online."""

    of: str = Field(description="`blocked`, or the name of an attribute")
    range: int = Field(default=1, ge=0, le=10_000, description="edges it looks ahead; 0: own location alone")
    accuracy: float = Field(default=1.0, ge=0, le=1, description="probability that one reading is right")


def _between(value: Any) -> tuple[LocationRef, LocationRef]:
    if not isinstance(value, tuple) or len(value) != 2 or is_cell(value):
        raise wrong(f"expected the two locations that the door is between, got {shown(value)}")
    return location_ref(value[0]), location_ref(value[1])


Between = Annotated[
    tuple[LocationRef, LocationRef],
    PlainValidator(_between),
    WithJsonSchema({"type": "array", "items": REF_SCHEMA, "minItems": 2, "maxItems": 2}),
]


class DoorSpec(Spec):
    """A door: while it is closed no move leads through it, in either direction."""

    between: Between = Field(description="two locations that an edge connects")
    open: Draws = Field(default=ALWAYS, description="whether it is open at first")
    changes: tuple[ProcessChangeSpec, ...] = Field(default=(), description="rules of change, in order")

    @property
    def process(self) -> ProcessSpec:
        """The door as a process of one variable: whether it is open."""
        return ProcessSpec.model_construct(type="bool", initial=self.open, changes=self.changes)


class SpaceSpec(Spec):
    """The places where the system moves. Give `grid`, or `locations` and `edges`, or `file`."""

    grid: GridSpec | None = Field(default=None, description="a rectangle of cells")
    locations: dict[Name, tuple[Coordinate, Coordinate]] | None = Field(
        default=None, min_length=1, description="name: [x, y] in metres, for drawing"
    )
    edges: tuple[tuple[str, str, Name], ...] | None = Field(
        default=None, description="[from, to, label]; directed, one label at most once per location"
    )
    file: str | None = Field(
        default=None, description="a YAML file with the content of `space`, relative to this one"
    )
    attributes: dict[Name, AttributeSpec] = Field(
        default={}, description="what expressions can read of a location"
    )
    detectors: dict[Name, DetectorSpec] = Field(default={}, description="what is seen online")
    doors: dict[Name, DoorSpec] = Field(default={}, description="name: a door, a variable: true is open")

    @model_validator(mode="after")
    def _one_kind(self) -> SpaceSpec:
        if self.file is not None:
            # A space that is nothing but `file` has been replaced by the file's content.
            raise wrong("file stands alone in space, and the file it names has none", ("file",))
        kinds = [key for key in ("grid", "locations") if getattr(self, key) is not None]
        if len(kinds) != 1:
            raise wrong(f"give exactly one of grid, locations and file, not {' and '.join(kinds) or 'none'}")
        if (self.edges is not None) != (self.locations is not None):
            raise wrong("locations and edges belong together: one of them is missing or there is a grid")
        return self
