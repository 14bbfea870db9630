"""The study of what comparisons cost prints the worst of each configuration."""

from __future__ import annotations

import pytest

from tests.studies import configurations


@pytest.mark.slow
def test_it_prints_seconds_and_memory_of_each_configuration(tmp_path, capsys) -> None:
    path = tmp_path / "brief.yaml"
    path.write_text("base: research_cone\nduration: 2.0\nsample_rate: 100.0\nstep: 0.01")
    assert configurations.main(["--seeds", "1", "--config", str(path)]) in (0, 1)
    head, row, end = capsys.readouterr().out.splitlines()
    assert head.split()[0] == "configuration"
    name, flights, seconds, most, seed, megabytes, _, *outcome = row.split()
    assert (name, flights, seed) == ("brief", "1", "1000")
    assert 0.0 < float(seconds) == float(most) < 100.0
    assert 50.0 < float(megabytes) < 4096.0
    assert outcome
    assert end.endswith("within 10 s and 1024 MB")
