#!/usr/bin/env python3
"""Writes docs/reference.md from the JSON Schema of pipelines:

    deaflow schema | python3 docs/tools/reference.py > docs/reference.md
"""

import json
import re
import sys

HEAD = """# Keys of pipelines and scenes

Written by `deaflow schema | python3 docs/tools/reference.py > docs/reference.md`; a test compares both. Ranges are in base
units; [file formats](file-formats.md#scenes-and-pipelines-yaml) describes how to write quantities. A key without a default is
required (**!**) or optional. A mapping that occurs twice is listed once, at its first occurrence.
"""


# Keys that all stages have; they are listed once.
SWEEPS = ("foreach", "gather")


def plain(schema, definitions):
    """Removes the axes of sweeps, which can replace any value, and writes out the sides of a membrane."""
    if isinstance(schema, list):
        return [plain(item, definitions) for item in schema]
    if not isinstance(schema, dict):
        return schema
    choices = schema.get("anyOf", [])
    if {"$ref": "#/$defs/axis"} in choices:
        hoisted = {key: value for key, value in schema.items() if key != "anyOf"}
        return plain({**choices[0], **hoisted}, definitions)
    if schema.get("$ref") == "#/$defs/side":
        own = {key: value for key, value in schema.items() if key != "$ref"}
        return plain({**definitions["side"], **own}, definitions)
    return {key: plain(value, definitions) for key, value in schema.items()}


def sentence(schema):
    """Returns a short description of a value with its range."""
    text = schema.get("description", "")
    text = re.sub(r"From (\S+) to (\S+) (\S+), in .*?; a bare number is in \S+?\.$", r"\1 to \2 \3.", text)
    text = re.sub(r"A number from (\S+) to (\S+)\.$", r"\1 to \2.", text)
    whole = schema.get("type") == "integer"
    # A description that names both ends, and nothing between them, needs no range.
    has_ends = whole and f"{schema.get('minimum')} or {schema.get('maximum')}." in text
    if whole and not has_ends and schema.get("maximum", 0) < 2**53:
        text += f" {schema['minimum']} to {schema['maximum']}."
    if "const" in schema:
        text += f" `{literal(schema['const'])}`."
    if "enum" in schema:
        text += " " + ", ".join(f"`{word}`" for word in schema["enum"]) + "."
    return text.strip()


def span(schema):
    """Returns the range of a number, of the first of several choices, or of the items of a list."""
    if "anyOf" in schema:
        return span(schema["anyOf"][0])
    if schema.get("type") == "array":
        return span(schema["items"])
    if is_mapping(schema):
        return ""
    found = re.search(r"-?[\d.e-]+ to -?[\d.e+-]+( \S+)?\.$", sentence(schema))
    return found.group(0) if found else ""


def with_span(text, schema):
    """Returns a description, with the range of the value unless it has one already."""
    range_of = span(schema)
    return text if not range_of or range_of in text else f"{text} {range_of}"


def described(schema):
    """Returns the first description among the choices of a value."""
    return next((sentence(choice) for choice in schema.get("anyOf", []) if is_mapping(choice)), "")


def is_mapping(schema):
    return "properties" in schema


def variants(schema):
    """Returns the mappings among the choices of a value."""
    found = []
    for choice in schema.get("anyOf", []):
        found += [choice] if is_mapping(choice) else variants(choice)
    return found


def choice_key(mapping, others):
    """Returns the key whose constant value distinguishes a mapping from others; one that all share does not."""
    words = [key for key, value in mapping["properties"].items() if "const" in value and key not in ("kind", "version")]
    shared = [key for key in words if len(others) > 1 and all(constant(key, mapping) == constant(key, other) for other in others)]
    return next((key for key in words if key not in shared), None)


def constant(key, mapping):
    """Returns the constant value of a key."""
    return mapping["properties"].get(key, {}).get("const")


def literal(value):
    """Returns a default in YAML syntax."""
    text = json.dumps(value, ensure_ascii=False).strip('"')
    return re.sub(r"e-0", "e-", re.sub(r"(\d)\.0\b", r"\1", text))


def is_new(mapping, shown=[]):
    """Returns whether no mapping with these keys has been listed yet."""
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
            yield from variant_rows(variant, variants(inner), inner_prefix)


def variant_rows(mapping, others, prefix):
    choice = choice_key(mapping, others)
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
        choices = [(choice_key(variant, variants(schema)), variant) for variant in variants(schema)]
        for key, variant in choices:
            parts.append(f"### {key}: {variant['properties'][key]['const']}")
            parts.append(variant["description"])
            parts.append(table(rows(variant, choice=key)))
    return "\n\n".join(part for part in parts if part)


def sweeps(definitions):
    keys = [(key, "", definitions[key]["description"]) for key in SWEEPS]
    return "\n\n".join(["## All stages", "[Sweeps](runs.md#sweep) use these keys.", table(keys)])


def main():
    schema = json.load(sys.stdin)
    schema = plain(schema, schema["$defs"])
    kinds = schema["$defs"]
    order = ["sample", "solve", "balance", "train", "calibrate", "evaluate", "design", "verify", "yield", "accuracy",
             "audit",
             "measure", "fit", "compare"]
    order += [kind for kind in kinds if kind not in order and kind not in ("scene", "shape", "side", "axis", *SWEEPS)]
    parts = [HEAD.strip(), section("Scene", kinds["scene"]), sweeps(kinds)]
    parts += [section(f"kind: {kind}", kinds[kind]) for kind in order if kind in kinds]
    print("\n\n".join(parts))


main()
