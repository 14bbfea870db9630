"""Result base classes: fields that are not a number are null in JSON, and come back as NaN."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, model_validator

from brv_hypo.errors import MissingInputError, UsageError
from brv_hypo.results import Tabular

_OF_EVERY_MODEL = frozenset(dir(BaseModel))


class NullIsNaN(BaseModel):
    """A part of a result: where a field is a number, or a mapping of names to numbers, null means not a number."""

    model_config = ConfigDict(frozen=True, populate_by_name=True, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _numbers(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        read = dict(data)
        for name, value in data.items():
            kind = cls.model_fields[name].annotation if name in cls.model_fields else None
            if kind is float and value is None:
                read[name] = float("nan")
            elif kind == dict[str, float] and isinstance(value, dict):
                read[name] = {key: float("nan") if each is None else each for key, each in value.items()}
        return read

    def __eq__(self, other: object) -> bool:
        """The same JSON: what is not a number equals itself, and histories for pictures are no part of it."""
        return type(self) is type(other) and self._written() == other._written()

    def __hash__(self) -> int:
        return hash(self._written())

    def __dir__(self) -> list[str]:
        """What the result has, without the methods of every pydantic model."""
        return [name for name in super().__dir__() if name.startswith("_") or name not in _OF_EVERY_MODEL]

    def _written(self) -> str:
        return self.model_dump_json(by_alias=True)


class Result(NullIsNaN, Tabular):
    """A result that survives JSON: what is not a number is written as null, and null is read as not a number."""

    __repr__ = __str__ = Tabular.__repr__

    def to_json(self) -> str:
        """The JSON of the contract; histories for pictures are no part of it."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"

    @classmethod
    def from_json(cls, source: str | Path) -> Self:
        """The result in the text that `to_json` or `--json` wrote, or in a file of it; UsageError where it is none."""
        try:
            is_json = isinstance(source, str) and source.lstrip().startswith("{")
            return cls.model_validate_json(str(source) if is_json else Path(source).read_text(encoding="utf-8"))
        except ValueError as error:
            raise UsageError(f"this is not the JSON of a {cls.__name__}: {str(error).splitlines()[0]}.") from None
        except OSError as error:
            reason = error.strerror or error
            refused = MissingInputError if isinstance(error, FileNotFoundError) else UsageError
            raise refused(f"{source} cannot be read: {reason}. Give the file that --json wrote.") from None
