#!/usr/bin/env python3
"""Measures how hard the project's text is to read, and fails if a group of texts has become worse than its bound in BOUNDS.

    tests/text_test.py             one row per group, the twenty worst sentences, status 1 above a bound
    tests/text_test.py --pages     one row per page: words and counts
    tests/text_test.py --bounds    BOUNDS as they are now, to take over after an improvement

Texts are the pages (docs/*.md by the groups of mkdocs.yml, and README.md), the comments of public headers, the messages (string literals of infer, cli
and the Python package, and the texts of the HTML report), and the options: descriptions of keys in docs/config.md and of arguments in cli. Five faults
are counted: a sentence of more than 30 words; one that begins with "Of" or "What" and asks nothing; one with two semicolons or more; a word for which
the glossary of docs/conventions.md has another one; and an option whose description has no verb."""

import pathlib
import re
import sys

sys.dont_write_bytecode = True
from layout_test import MODULES, files_of, module_of  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[1]
FAULTS = ("over 30 words", "of, what", "semicolons", "words", "no verb")
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
    r"\bseen through\b(?! (?:its|the) lens)": "free-space violation, the sensor looks through",
    r"\b(?:samples|seconds|frames|bytes|rows|points|lines|pixels|figures|files|runs) an? (?:second|pixel|sensor|sample|step|frame|parameter|rig|row|minute|run)\b": "per",
}
# Each group's most faults, in the order of FAULTS.
BOUNDS = {
    "messages: cli": [0, 0, 4, 0, 0],
    "options: cli": [0, 0, 0, 0, 34],
    "options: docs": [0, 0, 0, 0, 63],
}


# Stems of verbs, to find descriptions of options that have none.
VERBS = re.compile(
    r"\b(?:is|are|was|were|be|has|have|had|do|does|may|can|must|will|(?:add|appl|average|begin|belong|change|choos|chose|come|comput|continu|correspond|count"
    r"|cover|decid|depend|differ|draw|drawn|drew|exist|expos|fail|find|found|fit|fix|follow|give|given|go|help|hide|hold|keep|kept|know|known|leave|left|lie"
    r"|list|load|look|los|make|made|match|measure|mov|nam|need|place|print|read|reflect|refin|render|replace|report|rise|run|say|see|seen|share|show|stand"
    r"|start|stat|sum|take|taken|train|turn|use|validat|win|write|written|zero)(?:e?s|e?d|ied|ies|y|ing)?)\b", re.IGNORECASE)


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
        part = re.sub(r"^- `[^`]*` \((?:[^()`]|`[^`]*`|\([^()]*\))*\): ", "", part)  # a key of docs/config.md, its default and limits
        if part.strip() and not re.match(r"\||#", part):
            part = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"`[^`]*`", "X", re.sub(r"^ *(?:[-*]|\d+\.) ", "", part)))
            found += sentences("\n".join(line for line in part.splitlines() if not line.startswith("|")))
    return found


def of_comments(text):
    """Sentences of comments that have lines of their own; code in them is left as it is."""
    blocks = re.findall(r"(?:^[ \t]*//.*\n)+", re.sub(r"(?ms)^[ \t]*///? ```.*?```$", "", text), re.MULTILINE)
    return [sentence for block in blocks for part in re.sub(r"^[ \t]*//[/<]* ?", "", block, flags=re.MULTILINE).split("\n\n") for sentence in sentences(part)]


def of_messages(text):
    """Sentences of string literals, neighbours joined, of four words or more. A line of a text ends one."""
    text = re.sub(r"^\s*(?://|#).*$", "", text, flags=re.MULTILINE)
    found = []
    for literal in re.findall(r'"(?:[^"\\\n]|\\.)*"(?:\s*"(?:[^"\\\n]|\\.)*")*', text):
        for line in re.sub(r'"\s*"', "", literal)[1:-1].split("\\n"):
            words = re.sub(r"\{[^{}]*\}|`[^`]*`", "X", re.sub(r"\\.", " ", line))
            found += sentences(words) if len(words.split()) > 3 else []
    return found


def of_report(text):
    """Sentences of the HTML report: paragraphs and cells of its page, and strings of its scripts that are no code."""
    texts = re.findall(r"<(?:p|h\d|li|td|th|figcaption)\b[^>]*>(.*?)</", text, re.DOTALL)
    if not texts:
        texts = [a or b for a, b in re.findall(r'"([^"\n]*)"|`([^`]*)`', re.sub(r"(?m)^\s*//.*$", "", re.sub(r'"\s*\+\s*"', "", text)))]
    words = [re.sub(r"\$\{[^{}]*\}", "X", re.sub(r"<[^>]*>", "", part)) for part in texts]
    return [sentence for part in words if len(part.split()) > 3 and not re.search(r"[{}=<>]|[\w)]\(", part) for sentence in sentences(part)]


def of_options(text):
    """Descriptions of keys in docs/config.md, or of arguments in a source of cli."""
    keys = re.findall(r"^- `[^`]*` \((?:[^()`]|`[^`]*`|\([^()]*\))*\): (.*(?:\n  .*)*)", text, re.MULTILINE)
    arguments = re.findall(r'add_(?:option|flag)\(\s*(?:"[^"]*",)\s*(?:[^"]*,\s*)?((?:"(?:[^"\\\n]|\\.)*"\s*)+)', text)
    return [re.sub(r"\s+", " ", part) for part in keys + [re.sub(r'"\s*"', "", part).strip().strip('"') for part in arguments]]


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
    for path in files_of((".cc",), ("cli", "infer", "bindings/python")):
        yield f"messages: {module_of(path) or 'bindings/python'}", path, of_messages((ROOT / path).read_text())
    for path in files_of((".js", ".html"), ("infer/report/html_report",)):
        yield "messages: infer/report", path, of_report((ROOT / path).read_text())
    for path in [*files_of((".cc",), ("cli",)), "docs/config.md"]:
        yield "options: " + path.split("/")[0], path, of_options((ROOT / path).read_text())


def faults(sentence, is_option=False):
    """How many of each of FAULTS. Options are also sentences of messages or pages, so only their verb counts. "What to do:" begins an advice."""
    if is_option:
        return [0, 0, 0, 0, int(not VERBS.search(sentence))]
    headless = re.match(r"Of |What (?!to do:)", sentence) and not sentence.endswith("?")
    words = sum(len(re.findall(pattern, sentence, re.IGNORECASE)) for pattern in WORDS)
    return [int(len(sentence.split()) > 30), int(bool(headless)), int(sentence.count(";") > 1), words, 0]


def total(rows):
    return [sum(column) for column in zip([0] * len(FAULTS), *rows)]


def check_itself():
    """Every measure finds a sentence that has its fault."""
    bad = "Of what was told, a still has a twin; it is held; so it is. " + "word " * 31 + "ends. What is this?"
    for found in (of_page(bad), of_comments(f"/// {bad}\n"), of_messages(f'"{bad}"'), of_report(f"<p>{bad}</p>"), of_report(f"el(`{bad}`)")):
        assert total(map(faults, found)) == [1, 1, 1, 4, 0], found
    options = of_options('- `seed` (`1`; >= 0): of the rig\n') + of_options('app->add_option("--seed", seed, "of the "\n "rig")')
    assert [faults(option, True)[4] for option in options] == [1, 1], options


def main():
    check_itself()
    groups, every = {}, []
    for group, place, found in texts():
        rows = [faults(sentence, group.startswith("options")) for sentence in found]
        every += [(sum(row), len(sentence.split()), place, sentence) for row, sentence in zip(rows, found)]
        if "--pages" in sys.argv and group.startswith("pages"):
            print(f"{len((ROOT / place).read_text().split()):6} words, {len(found):4} sentences; {total(rows)}  {place}")
        groups[group] = total([groups.get(group, [0] * len(FAULTS)), *rows])
    if "--bounds" in sys.argv:
        print("\n".join(f'    "{group}": {counts},' for group, counts in groups.items() if any(counts)))
        return 0
    print("\n".join(f"{group}: {counts}" for group, counts in groups.items()))
    for _, length, place, sentence in sorted(every, key=lambda row: (row[0], row[1]), reverse=True)[:20]:
        print(f"{place}, {length} words: {sentence}")
    none = [0] * len(FAULTS)
    worse = [f"{group}: {count} with {fault}, at most {bound}" for group, counts in groups.items()
             for fault, count, bound in zip(FAULTS, counts, BOUNDS.get(group, none)) if count > bound]
    worse += [f"{group}: has a bound and no text" for group in BOUNDS if group not in groups]
    print("\n".join(["FAILED: write these sentences anew, in short ones", *worse] if worse else ["no group is above its bound"]))
    return bool(worse)


if __name__ == "__main__":
    sys.exit(main())
