#!/usr/bin/env python3
"""The tables of docs/reference.md, from the JSON Schema of pipelines:

    deaflow schema | python3 docs/tools/reference.py > docs/reference.md
"""

import json
import re
import sys

HEAD = """# Keys of pipelines and scenes

Written by `deaflow schema | python3 docs/tools/reference.py > docs/reference.md`; a test holds it to the program. Ranges are in base
units; [file formats](file-formats.md#scenes-and-pipelines-yaml) tells how quantities are written. A key without a default is
required (**!**) or may be left out. Keys of a mapping that stands here twice are listed where it stands first.
"""


# Keys that all stages have; they are listed once.
SWEEPS = ("foreach", "gather")


def plain(schema):
    """Without the axes of sweeps, which may stand in place of any value."""
    if isinstance(schema, list):
        return [plain(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    choices = schema.get("anyOf", [])
    if {"$ref": "#/$defs/axis"} in choices:
        hoisted = {key: value for key, value in schema.items() if key != "anyOf"}
        return plain({**choices[0], **hoisted})
    return {key: plain(value) for key, value in schema.items()}


def sentence(schema):
    """What a value is, in as few words as hold its range."""
    text = schema.get("description", "")
    text = re.sub(r"From (\S+) to (\S+) (\S+), in .*?; a bare number is in \S+?\.$", r"\1 to \2 \3.", text)
    text = re.sub(r"A number from (\S+) to (\S+)\.$", r"\1 to \2.", text)
    whole = schema.get("type") == "integer"
    if whole and schema.get("maximum", 0) < 2**53:
        text += f" {schema['minimum']} to {schema['maximum']}."
    if "const" in schema:
        text += f" `{schema['const']}`."
    if "enum" in schema:
        text += " " + ", ".join(f"`{word}`" for word in schema["enum"]) + "."
    return text.strip()


def span(schema):
    """The range of a number, of the first of several choices, or of the items of a list."""
    if "anyOf" in schema:
        return span(schema["anyOf"][0])
    if schema.get("type") == "array":
        return span(schema["items"])
    if is_mapping(schema):
        return ""
    found = re.search(r"-?[\d.e-]+ to -?[\d.e+-]+( \S+)?\.$", sentence(schema))
    return found.group(0) if found else ""


def with_span(text, schema):
    """A sentence, with the range of what it is about if it does not say it."""
    range_of = span(schema)
    return text if not range_of or range_of in text else f"{text} {range_of}"


def described(schema):
    """The first sentence among what a value may be."""
    return next((sentence(choice) for choice in schema.get("anyOf", []) if is_mapping(choice)), "")


def is_mapping(schema):
    return "properties" in schema


def variants(schema):
    """The mappings that a value may be, in place of one."""
    found = []
    for choice in schema.get("anyOf", []):
        found += [choice] if is_mapping(choice) else variants(choice)
    return found


def choice_key(mapping):
    """The key whose word says which of several mappings this is."""
    words = [key for key, value in mapping["properties"].items() if "const" in value and key not in ("kind", "version")]
    return words[0] if words else None


def literal(value):
    """A default as it is written in YAML."""
    text = json.dumps(value, ensure_ascii=False).strip('"')
    return re.sub(r"e-0", "e-", re.sub(r"(\d)\.0\b", r"\1", text))


def is_new(mapping, shown=[]):
    """Whether no mapping with all these keys has been shown."""
    keys = {(key, value.get("description")) for key, value in mapping["properties"].items() if key not in ("kind", "needs")}
    if any(keys <= others for others in shown):
        return False
    shown.append(keys)
    return True


def rows(mapping, prefix="", choice=None):
    required = mapping.get("required", [])
    keys = [key for key in mapping["properties"] if key not in ("kind", choice, *SWEEPS)]
    for key in sorted(keys, key=lambda key: (key not in required, key == "needs", key)):
        value = mapping["properties"][key]
        name = f"{prefix}{key}"
        inner = value.get("items", value) if value.get("type") == "array" else value
        inner_prefix = f"{name}[]." if inner is not value else f"{name}."
        default = f"`{literal(value['default'])}`" if "default" in value else ""
        yield name, "**!**" if key in required else default, with_span(sentence(value) or sentence(inner) or described(inner), value)
        if is_mapping(inner) and is_new(inner):
            yield from rows(inner, inner_prefix)
        for variant in filter(is_new, variants(inner)):
            yield from variant_rows(variant, inner_prefix)


def variant_rows(mapping, prefix):
    choice = choice_key(mapping)
    if choice:
        yield f"{prefix}{choice}: {mapping['properties'][choice]['const']}", "", sentence(mapping)
    yield from rows(mapping, prefix, choice)


def table(found):
    lines = ["| key | default | |", "|---|---|---|"]
    seen = set()
    for name, mark, text in found:
        line = f"| `{name}` | {mark} | {text.replace('|', chr(92) + '|')} |"
        if line not in seen:
            lines.append(line)
        seen.add(line)
    return "\n".join(lines)


def section(title, schema):
    parts = [f"## {title}", schema.get("description", "")]
    if is_mapping(schema):
        is_new(schema)
        parts.append(table(rows(schema)))
    else:
        choices = [(choice_key(variant), variant) for variant in variants(schema)]
        for key, variant in choices:
            parts.append(f"### {key}: {variant['properties'][key]['const']}")
            parts.append(variant["description"])
            parts.append(table(rows(variant, choice=key)))
    return "\n\n".join(part for part in parts if part)


def sweeps(definitions):
    keys = [(key, "", definitions[key]["description"]) for key in SWEEPS]
    return "\n\n".join(["## All stages", "[Sweeps](runs.md#sweep) tell what they do.", table(keys)])


def main():
    schema = plain(json.load(sys.stdin))
    kinds = schema["$defs"]
    order = ["sample", "solve", "balance", "train", "calibrate", "evaluate", "design", "verify", "accuracy", "audit"]
    order += [kind for kind in kinds if kind not in order and kind not in ("scene", "axis", *SWEEPS)]
    parts = [HEAD.strip(), section("Scene", kinds["scene"]), sweeps(kinds)]
    parts += [section(f"kind: {kind}", kinds[kind]) for kind in order if kind in kinds]
    print("\n\n".join(parts))


main()
