"""A traced model from the file that `trace --json` wrote."""

from __future__ import annotations

import json
from pathlib import Path

from brv_hypo.errors import UsageError
from brv_hypo.residuals.saved import SavedModel

_REMEDY = "Give what `trace --json` wrote."


def read_model(path: Path) -> SavedModel:
    """The model that a trace ended with, with its coefficients.

    Raises UsageError where the file is none, or holds no coefficients.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        model = SavedModel.model_validate(content["model"]["definition"])
    except OSError as error:
        raise UsageError(f"the model {path} cannot be read ({error.strerror}). Check the path.") from None
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{path} holds no traced model ({type(error).__name__}: {error}). {_REMEDY}") from None
    if not model.columns or any(column.value is None for column in model.columns):
        raise UsageError(
            f"the model in {path} holds no coefficients, which a prediction needs: an earlier version wrote it. "
            "Trace its flight anew with --json."
        )
    return model
