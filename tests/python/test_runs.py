"""Errors of runs of the simulator."""

from pathlib import Path

import pytest

from pyinfra.dataset import runs


def test_wrong_configuration_keeps_the_message_of_the_binary(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text("name: [1\n")
    with pytest.raises(runs.SimulatorError, match=r"infrasim check: .*scene\.yaml:") as error:
        runs.infrasim("check", scene)
    assert error.value.exit_code == 2
