#!/usr/bin/env python3
"""Measures how hard the project's text is to read, and fails if a group of texts has become worse than its bound in BOUNDS.

    tests/text_test.py             one row per group, the twenty worst sentences, status 1 above a bound
    tests/text_test.py --pages     one row per page: words and counts
    tests/text_test.py --bounds    BOUNDS as they are now, to take over after an improvement

Texts are the pages (docs/*.md by the groups of mkdocs.yml, and README.md), the comments of public headers, and the messages: string literals of infer and cli.
Four faults are counted: a sentence of more than 30 words; one that begins with "Of" or "What" and asks nothing; one with two semicolons or more; and a
word for which the glossary of docs/conventions.md has another one."""

import pathlib
import re
import sys

sys.dont_write_bytecode = True
from layout_test import MODULES, files_of, module_of  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[1]
FAULTS = ("over 30 words", "of, what", "semicolons", "words")
# Words that this project used for things that have another name: pattern -> name. Only those that no other sense has.
WORDS = {
    r"\bstills\b|\b(?:a|one|each|the|first|new|every|another|same|per|later) still\b(?! \w*(?:frame|scene|image|depth|more|less))": "capture",
    r"\btwins?\b|\baliase[sd]\b": "alternative, symmetry, duplicate sensor",
    r"\b(?:rivals?|competitors?)\b": "hypothesis",
    r"\bstray(?:s|ed|ing)?\b": "deviate, prior sigma",
    r"\btold\b": "identifiable",
    r"\bheld\b(?![ -]out)": "fixed",
    r"\b(?:set|stands?|left) aside\b": "excluded",
    r"\bbounced light\b": "multipath",
    r"\b(?:samples|seconds|frames|bytes|rows|points|lines|pixels|figures|files|runs) an? (?:second|pixel|sensor|sample|step|frame|parameter|rig|row|minute|run)\b": "per",
}
# Each group's most faults, in the order of FAULTS.
BOUNDS = {
    "pages: Use": [4, 0, 15, 1],
    "headers: core": [0, 0, 1, 0],
    "messages: cli": [1, 0, 5, 2],
    "messages: infer/checks": [5, 0, 1, 0],
    "messages: infer/evaluate": [0, 1, 0, 0],
    "messages: infer/formats": [0, 0, 10, 0],
    "messages: infer/plan": [2, 0, 0, 0],
    "messages: infer/report": [2, 0, 0, 0],
    "messages: infer/rigcheck": [0, 0, 1, 4],
    "messages: infer/stack": [0, 0, 1, 0],
}


def sentences(text):
    """Of a paragraph. An abbreviation ends none."""
    text = re.sub(r"\s+", " ", text).strip()
    return [part for part in re.split(r"(?<!e\.g\.)(?<!i\.e\.)(?<!et al\.)(?<=[.!?])[)\"”*]{0,3} (?=[\"“(]?[A-Z0-9`~]|\*)", text) if len(part.split()) > 2]


def of_page(text):
    """Sentences of Markdown: without code, tables, headings and targets of links. An item of a list begins a paragraph."""
    text = re.sub(r"^```.*?^```$|<!--.*?-->|!\[[^\]]*\]\([^)]*\)", "", text, flags=re.MULTILINE | re.DOTALL)
    found = []
    paragraphs = [block for block in re.split(r"\n\s*\n", text) if not all(line.startswith("    ") for line in block.splitlines())]
    for part in (part for block in paragraphs for part in re.split(r"\n(?= *(?:[-*]|\d+\.) )", block)):
        if part.strip() and not re.match(r"\||#", part):
            part = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"`[^`]*`", "X", re.sub(r"^ *(?:[-*]|\d+\.) ", "", part)))
            found += sentences("\n".join(line for line in part.splitlines() if not line.startswith("|")))
    return found


def of_comments(text):
    """Sentences of comments that have lines of their own; code in them is left as it is."""
    blocks = re.findall(r"(?:^[ \t]*//.*\n)+", text, re.MULTILINE)
    return [sentence for block in blocks for part in re.sub(r"^[ \t]*//[/<]* ?", "", block, flags=re.MULTILINE).split("\n\n") for sentence in sentences(part)]


def of_messages(text):
    """Sentences of string literals, neighbours joined, of four words or more."""
    text = re.sub(r"^\s*(?://|#).*$", "", text, flags=re.MULTILINE)
    found = []
    for literal in re.findall(r'"(?:[^"\\\n]|\\.)*"(?:\s*"(?:[^"\\\n]|\\.)*")*', text):
        words = re.sub(r"\{[^{}]*\}", "X", re.sub(r"\\.", " ", re.sub(r'"\s*"', "", literal)[1:-1]))
        found += sentences(words) if len(words.split()) > 3 else []
    return found


def page_groups():
    """Group -> pages of mkdocs.yml."""
    groups, group = {"front": ["README.md", "docs/index.md"]}, None
    for line in (ROOT / "mkdocs.yml").read_text().splitlines():
        if found := re.match(r"  - (.+):$", line):
            group = found[1]
        elif found := re.match(r"      - (\S+\.md)$", line):
            groups.setdefault(group, []).append(f"docs/{found[1]}")
    return groups


def texts():
    """(group, place, sentences) of everything."""
    for group, pages in page_groups().items():
        for page in pages:
            yield f"pages: {group}", page, of_page((ROOT / page).read_text())
    for name, module in sorted(MODULES.items()):
        for header in module.headers:
            yield f"headers: {name.split('/')[0]}", header, of_comments((ROOT / header).read_text())
    for path in files_of((".cc",), ("cli", "infer")):
        yield f"messages: {module_of(path)}", path, of_messages((ROOT / path).read_text())


def faults(sentence):
    """How many of each of FAULTS."""
    headless = re.match(r"(?:Of|What) ", sentence) and not sentence.endswith("?")
    words = sum(len(re.findall(pattern, sentence, re.IGNORECASE)) for pattern in WORDS)
    return [int(len(sentence.split()) > 30), int(bool(headless)), int(sentence.count(";") > 1), words]


def total(parts):
    return [sum(column) for column in zip([0, 0, 0, 0], *map(faults, parts))]


def main():
    bad = "Of what was told, a still has a twin; it is held; so it is. " + "word " * 31 + "ends. What is this?"
    assert total(of_page(bad)) == [1, 1, 1, 4], total(of_page(bad))
    groups, every = {}, []
    for group, place, found in texts():
        every += [(sum(faults(sentence)), len(sentence.split()), place, sentence) for sentence in found]
        counts = total(found)
        if "--pages" in sys.argv and place.endswith(".md"):
            print(f"{len((ROOT / place).read_text().split()):6} words, {len(found):4} sentences; {counts}  {place}")
        groups[group] = [a + b for a, b in zip(groups.get(group, [0, 0, 0, 0]), counts)]
    if "--bounds" in sys.argv:
        print("\n".join(f'    "{group}": {counts},' for group, counts in groups.items() if any(counts)))
        return 0
    print("\n".join(f"{group}: {counts}" for group, counts in groups.items()))
    for _, length, place, sentence in sorted(every, key=lambda row: (row[0], row[1]), reverse=True)[:20]:
        print(f"{place}, {length} words: {sentence}")
    worse = [f"{group}: {count} with {fault}, at most {bound}" for group, counts in groups.items()
             for fault, count, bound in zip(FAULTS, counts, BOUNDS.get(group, [0, 0, 0, 0])) if count > bound]
    worse += [f"{group}: has a bound and no text" for group in BOUNDS if group not in groups]
    print("\n".join(["FAILED: write these sentences anew, in short ones", *worse] if worse else ["no group is above its bound"]))
    return bool(worse)


if __name__ == "__main__":
    sys.exit(main())
