"""Settings from YAML files and mappings, and commented files to start from; any layer may use it.

`settings_of` and `problems_of` have one wording for what is wrong: each setting, the value that it has and
what is expected. `takes_settings` gives a function the settings as keywords. `commented` writes a YAML file in which
every setting has its default, below its meaning, which is the description of the model's field.
"""

from __future__ import annotations

import inspect
import re
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from inspect import formatannotation
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import to_json

from brv_hypo.errors import UsageError
from brv_hypo.io.mappings import read_yaml
from brv_hypo.io.text import meant, nearest, one_line

Settings = TypeVar("Settings", bound=BaseModel)
Function = TypeVar("Function", bound=Callable[..., Any])


def settings_of(
    model: type[Settings],
    source: Settings | Mapping[str, Any] | str | Path | None,
    keywords: Mapping[str, Any] = {},
    others: Sequence[str] = (),
) -> Settings:
    """Settings as they are, of a mapping or YAML file, or defaults (None), under `keywords`; UsageError if wrong.
    `others`: what an unknown keyword may mean beside settings.
    """
    if isinstance(source, model) and not keywords:
        return source
    where, content = "the settings", dict[str, Any]()
    if isinstance(source, model):
        content = {name: getattr(source, name) for name in source.model_fields_set}
    elif isinstance(source, Mapping):
        content = dict(source)
    elif isinstance(source, str | Path):
        content, where = read_yaml(source, "settings"), f"the settings in {source}"
    elif source is not None:
        expected = f"a {model.__name__}, a mapping of its fields, or the path of a YAML file"
        raise UsageError(f"got settings of type {type(source).__name__}, expected {expected}.")
    try:
        return model.model_validate({**content, **keywords})
    except ValidationError as error:
        known = (*model.model_fields, *others)
        otherwise = f"known are {', '.join(known)}; start, stop and instruments are what `load_flight` takes"
        problems = problems_of(error, lambda place: meant(str(place[-1]), known, otherwise, cutoff=0.5), model)
        raise UsageError(f"{where}: {problems}.") from None


def problems_of(
    error: ValidationError,
    hint: Callable[[Sequence[str | int]], str] = lambda place: "",
    model: type[BaseModel] | None = None,
) -> str:
    """All that is wrong with data, by place; `hint` says what an unknown key may mean, `model` what a field is."""
    found, places = [], {detail["loc"] for detail in error.errors()}
    for detail in error.errors():
        location, value = detail["loc"], detail["input"]
        place = ".".join(str(part) for part in location) or "the whole"
        if any(location == each[: len(location)] != each for each in places):  # of a tuple with a wrong element
            continue
        if detail["type"] == "missing":
            found.append(f"'{place}' is missing")
        elif detail["type"] in ("extra_forbidden", "unexpected_keyword_argument"):  # of a model, of a dataclass
            meaning = hint(location)
            found.append(f"'{place}' is not a known key" + (f" ({meaning})" if meaning else ""))
        else:
            text = one_line(repr(value))
            got = f", got {f'an object of type {type(value).__name__}' if ' at 0x' in text else text}"
            fields = {} if model is None else model.model_fields
            field = fields.get(str(location[0])) if location else None
            words = " ".join((field.description or "").split()).rstrip(".") if field is not None else ""
            about = f" ({location[0]}: {words})" if words else ""
            message = detail["msg"].removeprefix("Value error, ").rstrip(".").partition(", unable to")[0]
            message = re.sub("^(Input should be|Tuple should have)", "expected", message)
            if detail["type"] == "literal_error" and (near := nearest(str(value), message.split("'")[1::2])):
                message += f" (is '{near[0]}' meant?)"
            found.append(f"'{place}': {message}{'' if isinstance(value, dict) else got}{about}")
    return "; ".join(found)


_FLIGHT = "str, Path, Flight or SimulatedFlight"
_SHARED = {
    "flight": f"{_FLIGHT}\n    The flight, or the path of its record.",
    "flights": f"{_FLIGHT}, or a sequence of these\n    Several flights are fitted jointly.",
    "config": "settings, mapping, str or Path, optional\n    Settings, or the YAML file that holds them.",
    "progress": "callable, rich or tqdm bar, optional\n    Called with fraction done and a text: `brv_hypo.progress`.",
}
_RAISES = """UsageError
    A name or a setting is unknown or wrong.
UnanswerableError
    The data cannot answer; the message says what is missing.
FlightRecordError
    A record cannot be read or is invalid."""


_CONFIGURED = type("Configured", (), {"__repr__": lambda self: "..."})()  # in a signature: the configuration has it


def _signed(field: FieldInfo) -> Any:
    """The default that a signature shows: a number, a name, None or a tuple as it is."""
    default = _CONFIGURED if field.is_required() else field.get_default(call_default_factory=True)
    return default if default is None or isinstance(default, str | int | float | tuple) else _CONFIGURED


def takes_settings(model: type[BaseModel], /, **parameters: str) -> Callable[[Function], Function]:
    """Name the settings in signature and docstring of a function that takes them as `**settings`, for completion. The
    docstring, of which only the text, `Returns` and `Examples` are written out, becomes one of numpydoc: with its
    parameters, as `parameters` describe them beside those that functions share, the settings, and what all raise. Type
    checkers have the settings from a TypedDict beside the model; the signature that `help` prints has names and simple
    defaults, the docstring the types.
    """

    def decorate(function: Function) -> Function:
        declared, meanings, fields = inspect.signature(function), {**_SHARED, **parameters}, model.model_fields
        *own, keywords = declared.parameters.values()
        typed = vars(sys.modules[model.__module__])[str(keywords.annotation).removeprefix("Unpack[").rstrip("]")]
        for name, kind in get_type_hints(typed).items():
            words = " ".join((fields[name].description or "See the class.").split())
            meanings[name] = re.sub(r"\b(?:\w+\.)+", "", formatannotation(kind)) + f"\n    {words}"
        signed = [each.replace(annotation=each.empty) for each in own]
        signed += [inspect.Parameter(n, keywords.KEYWORD_ONLY, default=_signed(f)) for n, f in fields.items()]
        function.__signature__ = inspect.Signature(signed)  # type: ignore[attr-defined]
        text, _, rest = inspect.cleandoc(function.__doc__ or "").partition("\n\nReturns\n-------\n")
        returns, _, examples = rest.partition("\n\nExamples\n--------\n")
        sections = {
            "Parameters": "\n".join(f"{each.name} : {meanings[each.name]}" for each in own),
            "Returns": returns,
            "Other Parameters": "\n".join(f"{name} : {meanings[name]}" for name in fields),
            "Raises": _RAISES,
            "Examples": examples,
        }
        parts = [f"{name}\n{'-' * len(name)}\n{content}" for name, content in sections.items() if content]
        function.__doc__ = "\n\n".join([text, *parts])
        return function

    return decorate


def commented(model: type[BaseModel], title: str) -> str:
    """A YAML file that sets nothing: each setting is commented out at its default, below what it means."""
    lines = [f"# {title}", "# Every setting is at its default; take away the # before one to change it.", ""]
    for name, field in model.model_fields.items():
        lines += [f"# {line}" for line in textwrap.wrap(field.description or "", 100)]
        default = field.get_default(call_default_factory=True)
        value = default if isinstance(default, str) else to_json(default).decode()
        lines += [f"#{name}: {value}", ""]
    return "\n".join(lines)
