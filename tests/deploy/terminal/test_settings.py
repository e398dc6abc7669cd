"""`wireswarm config`: every setting of the models is listed with its reason, and the file loads to the defaults."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from deploy.config import RunConfig, load
from deploy.terminal.settings import DERIVED, listed, settings, to_json, to_text, to_yaml
from protocol.configuration import ConfigError
from protocol.errors import InputError
from world.radio.config import Bernoulli


def leaves(tree: dict[str, Any], prefix: str = "") -> Iterator[str]:
    for name, value in tree.items():
        if isinstance(value, BaseModel):
            yield from leaves(dict(value), f"{prefix}{name}.")
        else:
            yield prefix + name


def test_the_list_holds_every_setting_of_the_code() -> None:
    keys = [one.key for one in settings()]
    assert [key for key in keys if "[" not in key] == [key for key in leaves(dict(RunConfig())) if key not in DERIVED]
    assert len(keys) == len(set(keys))
    for field in Bernoulli.model_fields:
        assert f"radio.models[bernoulli].{field}" in keys


def test_what_is_not_listed_cannot_be_set() -> None:
    assert set(DERIVED) < set(leaves(dict(RunConfig())))
    for key in DERIVED:
        with pytest.raises(ConfigError, match="set these"):
            load(None, {key: 100})


def test_every_setting_has_a_docstring_below_it() -> None:
    assert [one.key for one in settings() if len(one.reason.split()) < 2] == []


def test_text_and_json_hold_every_setting_with_unit_and_default() -> None:
    text = to_text()
    assert re.findall(r"^(\S+) = ", text, re.M) == [one.key for one in settings()]
    assert "radio.range_m = 4.0 m\n" in text and "radio.models[bernoulli].loss = (required)\n" in text
    listed = {one["key"]: one for one in json.loads(to_json())}
    assert listed["max_time_s"]["default"] == 7200.0 and listed["max_time_s"]["unit"] == "s"
    assert listed["starts"]["choices"] == "file | random"
    assert listed["radio.models[capacity].bytes_per_s"]["unit"] == "B/s"
    assert listed["agent.radio.cell_mm"]["unit"] == "mm"


def test_the_file_loads_to_the_defaults_and_a_changed_line_changes_one_setting(tmp_path: Path) -> None:
    file = tmp_path / "run.yaml"
    file.write_text(to_yaml())
    assert load(file) == RunConfig()
    file.write_text(to_yaml().replace("\n  range_m: 4.0\n", "\n  range_m: 6.5\n"))
    changed = load(file)
    assert changed.radio.range_m == 6.5
    assert changed.model_copy(update={"radio": RunConfig().radio}) == RunConfig()


def test_a_group_that_is_given_stays_as_it_is() -> None:
    given = {"radio": {"mtu_bytes": 1000}}
    assert load(None, {**given, "radio.range_m": 2.0}).radio.range_m == 2.0
    assert given == {"radio": {"mtu_bytes": 1000}}


def test_the_settings_of_a_group_alone_are_listed() -> None:
    assert {one.key for one in listed("radio")} == {one.key for one in settings() if one.key.startswith("radio.")}
    assert [one.key for one in listed("agent.filter.particles")] == ["agent.filter.particles"]
    assert to_yaml("radio").splitlines()[1] == "radio:"
    with pytest.raises(InputError, match=r"^radi: no such setting nor group"):
        listed("radi")


@pytest.mark.parametrize("of", ["radio.models[bernoulli]", "radio.range_m", "radio.models", "agent.filter"])
def test_what_is_listed_of_a_group_is_a_file_that_can_be_loaded(tmp_path: Path, of: str) -> None:
    (file := tmp_path / "run.yaml").write_text(text := to_yaml(of))
    assert load(file) == RunConfig()
    assert ("radio.models[bernoulli].loss = " in text) == of.startswith("radio.models")
