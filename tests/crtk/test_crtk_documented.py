"""What somebody else's robot must write: the tables of docs/crtk.md against the classes that read it."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec

from gpcorrect_service.crtk.bus import read_message
from gpcorrect_service.crtk.messages import TOPICS, Pose

DOCS = (Path(__file__).parents[2] / "docs" / "crtk.md").read_text()


def rows(header: str) -> list[list[str]]:
    """Return the cells of a table, without what stands in parentheses."""
    table = DOCS.partition(header)[2].partition("\n|---|---|---|\n")[2].partition("\n\n")[0]
    return [[re.sub(r"\(.*?\)", "", cell) for cell in line.split("|")[1:4]] for line in table.splitlines()]


def test_every_field_of_every_message_is_documented() -> None:
    """Kinds, keys, fields, and which of these may be left out, are those of the messages that are read."""
    described = {
        (re.findall(r"`(.+?)`", kind)[0], key): set(re.findall(r"\[?`\w+`\]?", fields))
        for kind, keys, fields in rows("| kind | keys | fields |")
        for key in re.findall(r"`(.+?)`", keys)
    }
    assert described == {
        (topic.kind, name): {
            f"`{field.name}`" if field.required else f"[`{field.name}`]" for field in msgspec.structs.fields(topic.form)
        }
        for name, topic in TOPICS.items()
    }


def test_every_topic_is_in_the_table_of_keys() -> None:
    """Whoever looks for a key finds who sends it."""
    keys = {key for row in rows("## Keys under") for key in re.findall(r"`(.+?)`", row[0])}
    assert keys == TOPICS.keys()


def test_the_example_is_read() -> None:
    """The JSON of the documentation is a pose."""
    example = DOCS.partition("```json\n")[2].partition("```")[0].encode()
    read = read_message(example, "application/json;gpcorrect.pose/1", TOPICS["tracker_cp"])
    assert isinstance(read, Pose)
    assert read.frame == "tracker"
