"""The base of all settings, their types, and the largest number."""

import re
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo


class Config(BaseModel):
    """Settings that cannot change. Unknown keys are refused, so that a typing error in a file is found."""

    # built when first asked to check something: a robot's process is handed settings that were checked
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True, defer_build=True)


RAN = {"ran": True}
"""Context for the settings of a run that was made: fewer robots may have come than settings of robots name."""


def is_to_come(info: ValidationInfo) -> bool:
    """Whether the settings are of a run that is to be made, in which all that they name must take part."""
    return not info.context


MAX_NUMBER = 1e9
"""Bounds the numbers of settings and messages, so that no sum, mean or square of them overflows (ours). Nothing in a
building is larger in any unit."""

Positive = Annotated[float, Field(ge=1e-3, le=MAX_NUMBER, allow_inf_nan=False)]
"""At least a thousandth: a smaller time or length makes endless work, and its inverse overflows."""
NotNegative = Annotated[float, Field(ge=0, le=MAX_NUMBER, allow_inf_nan=False)]
Chance = Annotated[float, Field(ge=0, le=1)]


def shaped(pattern: str, form: str) -> AfterValidator:
    """That a text is as a pattern has it, all of it; else an error names the form, for people, with an example."""

    def check(text: str) -> str:
        if re.fullmatch(pattern, text) is None:
            raise ValueError(form)
        return text

    return AfterValidator(check)
