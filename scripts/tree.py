"""What the check-* scripts share: the tree's files, code without its comments and texts, and how a check ends."""
import argparse
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
PRODUCT = ("common", "chaincode", "onboard", "ground", "sim", "hil", "tools")
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.M)
# Not code: comments, texts, characters (a digit's separator is none), lines for the preprocessor.
NO_CODE = re.compile(r"""//[^\n]*|/\*.*?\*/|R"(\w*)\(.*?\)\1"|"(?:\\.|[^"\\\n])*"|(?<![0-9a-fA-F])'(?:\\.|[^'\\\n])+'|^[ \t]*#(?:\\\n|[^\n])*""",
                     re.S | re.M)


def root_asked_for(about):
    """The tree to read: this one, or --root DIR. `about`: the script's help."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=pathlib.Path, default=ROOT)
    return parser.parse_args().root


def files(root, suffixes=None):
    """Paths below the root of all that git knows; of a tree without git: of all that is there. Sorted."""
    listed = subprocess.run(["git", "-C", str(root), "ls-files"], capture_output=True, text=True).stdout.split("\n")
    names = [name for name in listed if name] or [path.relative_to(root).as_posix() for path in root.rglob("*")]
    return [pathlib.PurePosixPath(name) for name in sorted(names)
            if (suffixes is None or pathlib.PurePosixPath(name).suffix in suffixes) and (root / name).is_file()]


def code(text):
    """The text with blanks in place of what is not code: each line and column stays."""
    return NO_CODE.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)


def report(wrong, summary):
    """Ends the script: with 1 and the lines of what is wrong, or with 0."""
    wrong = list(wrong)
    for line in wrong:
        print(line, file=sys.stderr)
    if wrong:
        sys.exit(f"{len(wrong)} {summary}")
