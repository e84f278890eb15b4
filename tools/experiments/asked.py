"""What `ledgerline experiment` is asked for; needs nothing but Python itself, so that help comes at once."""
import argparse
import pathlib
import sys

import config


def root() -> pathlib.Path:
    return config.HERE.parent.parent


def arguments(experiments: list[config.Experiment]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="ledgerline experiment", formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Repeats the published experiments, and some beyond, on the programs themselves. Writes one JSON an\n"
        "experiment, figures, and report.html, which needs no network. What is finished is kept under --out: the same\n"
        "command goes on after an interrupt.",
        epilog="Experiments:\n" + "\n".join(f"  {one.name:<11} {one.number:>2}. {one.title}" for one in experiments) +
        "\n  all         every one\n  report      figures and page once more, from what is under --out\n\nExamples:\n"
        "  ledgerline experiment latency --quick\n  ledgerline experiment all --quick\n"
        "  ledgerline experiment all --ledger fabric --out /var/tmp/experiments\n\n"
        "Exit codes: 0 all was measured (a bar that is missed is a figure); 1 something was not; 2 bad usage.")
    parser.add_argument("name", choices=[one.name for one in experiments] + ["all", "report"], metavar="NAME")
    parser.add_argument("--quick", action="store_true", help="few repetitions, short ones: a look, not a result")
    parser.add_argument("--ledger", choices=("embedded", "fabric"), default="embedded")
    parser.add_argument("--storage", choices=("disk", "tmpfs"), default="disk", help="where ledgers lie [disk]")
    parser.add_argument("--seeds", type=int, metavar="N", help="repetitions of each case, instead of the config's")
    parser.add_argument("--case", action="append", default=[], metavar="CASE", help="only this one; may be given again")
    parser.add_argument("--out", type=pathlib.Path, metavar="DIR",
                        help="[build/experiments/LEDGER, with --quick build/experiments/LEDGER-quick]")
    asked = parser.parse_args()
    if asked.seeds is not None and not 1 <= asked.seeds <= 1000:
        parser.error("--seeds: from 1 to 1000")
    known = {case.name for one in experiments if asked.name in (one.name, "all") for case in one.cases}
    for case in asked.case:
        if case not in known:
            parser.error(f"--case: {case!r} is none of {'; '.join(sorted(known))}")
    asked.out = (asked.out or root() / "build/experiments" / (asked.ledger + ("-quick" if asked.quick else ""))).resolve()
    return asked


if __name__ == "__main__":
    try:
        arguments(config.read_all())
    except config.ConfigError as error:
        print(f"experiment: {error}", file=sys.stderr)
        sys.exit(2)
