#!/usr/bin/env python3
"""Makes of files a C++ source with page_files of ground/service/shell/page_files.hpp: the bytes come in by the assembler, which takes them
as they are in no time.

Usage: embed_files.py OUT.cpp NAME=FILE...
What is named lib/... is kept as gzip has it. Beside the files there is lib/built.js, which says whether any of those is there, and
page_scripts: the hashes of what a page holds of scripts itself, for its Content-Security-Policy. Before its module script a page names all
modules that this one imports, and those import in turn, so that a browser asks for them at once and not for one after the other.
"""
import base64
import gzip
import hashlib
import pathlib
import posixpath
import re
import sys

SCRIPT = re.compile(r"<script(?![^>]*\ssrc=)[^>]*>(.*?)</script>", re.S)

MODULE = re.compile(r'<script type="module" src="/page/([^"]+)"')
IMPORT = re.compile(r"^import [^;]*?from '(\.{1,2}/[^']+)';", re.M)  # what is imported later, when it is needed, is not meant


def imported_by(name, files, seen):
    """Adds to `seen` what that module needs, itself too."""
    if name in seen:
        return
    seen.append(name)
    for other in IMPORT.findall(files[name].read_text()):
        imported_by(posixpath.normpath(posixpath.join(posixpath.dirname(name), other)), files, seen)


def with_preloads(page, files):
    modules = []
    for name in MODULE.findall(page):
        imported_by(name, files, modules)
    links = "".join(f'<link rel="modulepreload" href="/page/{name}">\n' for name in modules)
    return MODULE.sub(lambda found: links + found[0], page, count=1)


def main():
    if len(sys.argv) < 3 or not all("=" in each for each in sys.argv[2:]):
        sys.exit(__doc__)
    out = pathlib.Path(sys.argv[1])
    files = {name: pathlib.Path(file) for name, _, file in (each.partition("=") for each in sys.argv[2:])}
    kept = out.with_suffix(".d")
    kept.mkdir(parents=True, exist_ok=True)
    hashes, rows, code = set(), [], []
    libraries = any(name.startswith("lib/") for name in files)
    files["lib/built.js"] = kept / "built.js"
    files["lib/built.js"].write_text(f"/// Whether three.js and uPlot are built in.\nexport const libraries = {str(libraries).lower()};\n")
    for number, (name, file) in enumerate(sorted(files.items())):
        data = file.read_bytes()
        if name.endswith(".html"):
            data = with_preloads(data.decode(), files).encode()
            file = kept / f"{number}.html"
            file.write_bytes(data)
            for script in SCRIPT.findall(data.decode()):
                hashes.add(f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'")
        zipped = name.startswith("lib/")
        if zipped:
            data = gzip.compress(data, 9, mtime=0)
            file = kept / f"{number}.gz"
            file.write_bytes(data)
        code.append(f'asm(".section .rodata\\n.globl ll_page_{number}\\n.hidden ll_page_{number}\\nll_page_{number}:\\n"\n'
                    f'    ".incbin \\"{file.resolve()}\\"\\n.previous\\n");\n'
                    f'extern "C" const unsigned char ll_page_{number}[];\n')
        rows.append(f'    {{"{name}", ll_page_{number}, {len(data)}, {str(zipped).lower()}}},\n')
    out.write_text('#include "ground/service/shell/page_files.hpp"\n\n' + "".join(code) + f"""
namespace ledgerline::ground::service {{
namespace {{
const PageFile files[] = {{
{"".join(rows)}}};
}}  // namespace
const PageFile* const page_files = files;
const std::size_t page_file_count = {len(rows)};
const char* const page_scripts = "{" ".join(sorted(hashes))}";
}}  // namespace ledgerline::ground::service
""")


if __name__ == "__main__":
    main()
