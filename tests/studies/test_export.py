"""Stores written as files: what is read back is what the store holds."""

from __future__ import annotations

import csv
import gzip
import json

import pytest
from test_study import NAME, asked, store  # noqa: F401  fixtures: a store in closed form

from contimpact.cli import main
from contimpact.errors import InputError
from contimpact.studies import export as export_module
from contimpact.studies.export import export

STEM = "it_s_a__study___DROP_TABLE_events"


def as_texts(rows):
    """Rows as CSV has them."""

    def text(value):
        if value is None:
            return ""
        return repr(value) if isinstance(value, float) else str(value)

    return [{name: text(value) for name, value in row.items()} for row in rows]


def test_csv_reads_back_to_the_bit(asked, store, tmp_path, monkeypatch):  # noqa: F811
    monkeypatch.setattr(export_module, "BLOCK", 7)
    written = export(store, tmp_path, names=[NAME])
    assert written[f"{STEM}-events.csv"] == 60
    assert {*written} == {path.name for path in tmp_path.iterdir()}
    with open(tmp_path / f"{STEM}-events.csv", newline="") as file:
        assert list(csv.DictReader(file)) == as_texts(asked.events())


def test_compressed_csv_is_the_same_bytes_every_time(store, tmp_path):  # noqa: F811
    for folder in ("one", "two"):
        export(store, tmp_path / folder, "csv.gz", tables=["events"])
    name = f"{STEM}-events.csv.gz"
    one, two = ((tmp_path / folder / name).read_bytes() for folder in ("one", "two"))
    assert one == two
    assert gzip.decompress(one).decode().startswith("scene,beta,r,event,")


def test_json_holds_the_same(asked, store, tmp_path):  # noqa: F811
    export(store, tmp_path, "json", names=[NAME], tables=["events", "curves"])
    assert json.loads((tmp_path / f"{STEM}-events.json").read_text()) == list(asked.events())
    assert json.loads((tmp_path / f"{STEM}-curves.json").read_text()) == []


def test_parquet_holds_the_same(asked, store, tmp_path):  # noqa: F811
    parquet = pytest.importorskip("pyarrow.parquet")
    export(store, tmp_path, "parquet", names=[NAME], tables=["events", "curves"])
    table = parquet.read_table(tmp_path / f"{STEM}-events.parquet")
    assert table.to_pylist() == list(asked.events())
    assert parquet.read_table(tmp_path / f"{STEM}-curves.parquet").num_rows == 0


def test_columns_and_digits(store, tmp_path):  # noqa: F811
    export(
        store, tmp_path, names=[NAME], tables=["events"], columns=["r", "label", "value"], digits=4
    )
    rows = (tmp_path / f"{STEM}-events.csv").read_text().splitlines()
    assert rows[:2] == ["r,label,value", "0.05,~PD,0.4819"]


def test_more_digits_than_a_number_has_are_all_of_them(store, tmp_path):  # noqa: F811
    texts = set()
    for digits in (None, 17, 10**14):
        export(store, tmp_path, names=[NAME], tables=["events"], digits=digits)
        texts.add((tmp_path / f"{STEM}-events.csv").read_text())
    assert len(texts) == 1


def test_columns_and_digits_that_there_are_not(store, tmp_path, capsys):  # noqa: F811
    command = ["export", str(store), "-o", str(tmp_path / "out")]
    for given, found in (
        (["--columns", "label,lable"], "columns: found 'lable'; accepted are scene, "),
        (["--columns", ""], "columns: found ''"),
        (["--digits", "0"], "digits: found 0; give a whole number >= 1"),
        (["--digits", "-1"], "digits: found -1"),
    ):
        assert main([*command, *given]) == 2
        assert found in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_tables_without_a_column_that_is_asked_for_are_left_out(store, tmp_path):  # noqa: F811
    assert {*export(store, tmp_path, names=[NAME], columns=["label"])} == {f"{STEM}-events.csv"}


@pytest.mark.parametrize("command", ["export", "atlas"])
def test_a_store_without_a_study(tmp_path, capsys, command):
    (tmp_path / "empty.sqlite").touch()
    assert main([command, str(tmp_path / "empty.sqlite"), "-o", str(tmp_path / "out")]) == 2
    assert "no study in it" in capsys.readouterr().err


def test_the_command_says_what_it_has_written(store, tmp_path, capsys):  # noqa: F811
    assert main(["export", str(store), "-o", str(tmp_path), "--study", "failed"]) == 0
    out = capsys.readouterr().out.splitlines()
    assert out == ["failed-scenes.csv: 1 row", "failed-failures.csv: 1 row"]


def test_what_cannot_be_written(store, tmp_path, capsys):  # noqa: F811
    with pytest.raises(InputError, match="found 'xml'"):
        export(store, tmp_path, "xml")
    (tmp_path / "file").write_text("")
    assert main(["export", str(store), "-o", str(tmp_path / "file")]) == 1
    assert "not written" in capsys.readouterr().err
    assert main(["export", str(store), "-o", str(tmp_path), "--table", "nothing"]) == 2
