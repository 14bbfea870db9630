"""A whole model as a file: what is declared, found and described, with values, errors and covariance.

YAML that a person can read and edit (`trace --write-model`), or the JSON of a trace, which holds the same.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from brv_hypo.errors import UsageError
from brv_hypo.io.mappings import YAML_ENDINGS, read_json, read_yaml
from brv_hypo.io.text import one_line
from brv_hypo.residuals.saved import SavedModel

_EXPECTED = "a model: what `trace --write-model` or `trace --json` wrote"


def read_model(path: Path) -> SavedModel:
    """The model in a file, with its coefficients.

    Raises UsageError where the file holds none, or one without coefficients.
    """
    model = read_structure(path)
    if not model.columns or any(column.value is None for column in model.columns):
        raise UsageError(
            f"the model in {path} holds no coefficients, which a prediction needs. Trace its flight anew with "
            "--write-model or --json, or give every column its value."
        )
    return model


def read_structure(path: Path) -> SavedModel:
    """The model in a file, with coefficients or without. Raises UsageError where the file holds none."""
    content = read_yaml(path, _EXPECTED) if path.suffix in YAML_ENDINGS else read_json(path, _EXPECTED)
    try:
        return SavedModel.model_validate(_definition(content))
    except ValidationError as error:
        said = "; ".join(f"{'.'.join(map(str, e['loc'])) or 'model'}: {e['msg']}" for e in error.errors()[:4])
        raise UsageError(f"{path} is not {_EXPECTED}: {one_line(said)}.") from None
    except (KeyError, TypeError) as error:
        raise UsageError(f"{path} holds no model ({type(error).__name__}: {error}); expected {_EXPECTED}.") from None


def is_model(content: dict[str, Any]) -> bool:
    """Whether a file's content is a model itself."""
    return content.get("format") == "brv-model"


def _definition(content: dict[str, Any]) -> Any:
    return content if is_model(content) else content["model"]["definition"]


def model_text(model: SavedModel) -> str:
    """The model as YAML; what is at its default is left out."""
    data = model.model_dump(mode="json", exclude_defaults=True)
    header = {"format": model.format, "format_version": model.format_version}
    return yaml.safe_dump({**header, **data}, sort_keys=False, width=110, default_flow_style=None)
