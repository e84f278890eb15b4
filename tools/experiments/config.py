"""An experiment's config: TOML, every key checked. Errors name the file and the key, and say what is allowed."""
import dataclasses
import itertools
import pathlib
import tomllib

HERE = pathlib.Path(__file__).resolve().parent
STYLE = (HERE.parent.parent / "common/page/style.css").read_text()  # of all pages
CONFIGS = HERE / "configs"

NUMBER = (int, float)
# What can be asked of a run, and of what type. `settings` is one of SETTINGS; the rest are options of the program.
FLIGHT = {"settings": str, "shape": str, "side": NUMBER, "drones": int, "rate": NUMBER, "speed": NUMBER, "laps": int,
          "seconds": NUMBER, "ramp": str, "predict": str, "max_age": str, "ledger": str, "storage": str, "orderers": int,
          "batch_count": int, "batch_timeout": str, "gateway": bool, "endorser": bool}
SITL = {"mode": str, "shape": str, "side": NUMBER, "drones": int, "rate": NUMBER, "speed": NUMBER, "laps": int, "ramp": str,
        "predict": str, "track": str, "max_age": NUMBER, "delay": (int, float, str), "delay_side": str, "model_error": NUMBER,
        "gust": NUMBER, "full_scale": NUMBER, "batch_count": int, "batch_timeout": NUMBER}
EXCHANGE = {"rates": list, "clients": list, "seconds": NUMBER, "warm_up": NUMBER, "drain": NUMBER, "ramp": str, "laps": int}
HOSTS = {"shape": str, "rate": NUMBER, "speed": NUMBER, "laps": int, "wifi": str}
OPTIONS = {"flight": FLIGHT, "sitl": SITL, "exchange": EXCHANGE, "hosts": HOSTS}
# The ledger's settings: what they mean for a flight.
SETTINGS = {"ours": {"batch_count": 1, "batch_timeout": "10ms", "orderers": 1},
            "published": {"batch_count": 10, "batch_timeout": "2s", "orderers": 3}}
RULES = {"times_below_published": {"factor"}, "at_most": {"figure", "limit"}, "at_least": {"figure", "limit"}}
LEDGERS = ("embedded", "fabric")
FIGURES = ("boxes", "trajectories", "velocities", "ramp", "exchange", "bars", "lines")


class ConfigError(Exception):
    """What is wrong, with file and key."""


@dataclasses.dataclass(frozen=True)
class Case:
    name: str
    options: dict
    published: str | None = None  # the box to stand beside it
    on: str | None = None         # the only ledger that it is for


@dataclasses.dataclass(frozen=True)
class Experiment:
    name: str
    number: int
    title: str
    question: str
    runs: str
    seeds: int
    cases: list[Case]
    bars: list[dict]
    figures: list[dict]
    notes: list[str]
    quick: bool


class Table:
    """A table of the file whose keys are taken one by one; what is left over is an error."""

    def __init__(self, file: pathlib.Path, where: str, values: dict):
        self.file, self.where, self.values = file, where, dict(values)

    def key(self, name: str) -> str:
        return f"{self.where}.{name}" if self.where else name

    def fail(self, name: str, what: str):
        raise ConfigError(f"{self.file}: {self.key(name)}: {what}")

    def take(self, name: str, kind, otherwise=None, required: bool = False):
        if name not in self.values:
            if required:
                self.fail(name, "is missing")
            return otherwise
        value = self.values.pop(name)
        if not is_of(value, kind):
            self.fail(name, f"{value!r} is no {name_of(kind)}")
        return value

    def choice(self, name: str, among, otherwise=None, required: bool = False):
        value = self.take(name, str, otherwise, required)
        if value is not None and value not in among:
            self.fail(name, f"{value!r} is none of {', '.join(among)}")
        return value

    def done(self) -> None:
        for name in self.values:
            self.fail(name, "there is no such key")


def is_of(value, kind) -> bool:
    kinds = kind if isinstance(kind, tuple) else (kind,)
    return isinstance(value, kinds) and (not isinstance(value, bool) or bool in kinds)


def name_of(kind) -> str:
    names = {str: "text", int: "whole number", float: "number", bool: "true or false", list: "list", dict: "table"}
    return " or ".join(dict.fromkeys(names[one] for one in (kind if isinstance(kind, tuple) else (kind,))))


def options_of(file: pathlib.Path, where: str, runs: str, values: dict) -> dict:
    table = Table(file, where, values)
    found = {name: table.take(name, kind) for name, kind in OPTIONS[runs].items() if name in values}
    if found.get("settings", "ours") not in SETTINGS:
        table.fail("settings", f"{found['settings']!r} is none of {', '.join(SETTINGS)}")
    table.done()
    return found


def cases_of(file: pathlib.Path, runs: str, common: dict, matrix: dict, tables: list, quick: dict, boxes,
             whole: dict) -> list[Case]:
    """`whole`: the matrix before quick's; an option that has several values there is in the names."""
    cases = []
    if matrix:
        for name, values in matrix.items():
            if not isinstance(values, list) or not values:
                raise ConfigError(f"{file}: matrix.{name}: {values!r} is no list of values")
            for value in values:
                options_of(file, "matrix", runs, {name: value})
        for values in itertools.product(*matrix.values()):
            chosen = dict(zip(matrix, values))
            name = ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in chosen.items() if len(whole[key]) > 1)
            cases.append(Case(name, {**common, **chosen, **quick}))
    for i, values in enumerate(tables):
        table = Table(file, f"case[{i}]", values)
        name = table.take("name", str, required=True)
        published, on = table.choice("published", boxes), table.choice("on", LEDGERS)
        cases.append(Case(name, {**common, **options_of(file, f"case[{i}]", runs, table.values), **quick}, published, on))
    if not cases:
        raise ConfigError(f"{file}: case: there is none, and no [matrix]")
    for case in cases:
        if [other.name for other in cases].count(case.name) > 1:
            raise ConfigError(f"{file}: case: {case.name!r} is there twice")
    return cases


def bar_of(file: pathlib.Path, where: str, values: dict, cases: list[Case]) -> dict:
    table = Table(file, where, values)
    bar = {"what": table.take("what", str, required=True), "rule": table.choice("rule", RULES, required=True),
           "ledger": table.choice("ledger", LEDGERS), "cases": table.take("cases", list),
           "against": table.take("against", str), "seeds": table.take("seeds", int, 10)}
    for name in RULES[bar["rule"]]:
        bar[name] = table.take(name, str if name == "figure" else NUMBER, required=True)
    table.done()
    known = {case.name: case for case in cases}
    for name in (bar["cases"] or []) + ([bar["against"]] if bar["against"] else []):
        if name not in known:
            table.fail("cases", f"{name!r} is none of {', '.join(known)}")
    if bar["cases"] is None:
        bar["cases"] = [case.name for case in cases if bar["rule"] != "times_below_published" or case.published]
    for name in bar["cases"]:
        if bar["rule"] == "times_below_published" and known[name].published is None:
            table.fail("cases", f"{name!r} has no published box beside it")
    return bar


def figure_of(file: pathlib.Path, where: str, values: dict, cases: list[Case]) -> dict:
    table = Table(file, where, values)
    figure = {"kind": table.choice("kind", FIGURES, required=True), "title": table.take("title", str, required=True),
              "cases": table.take("cases", list), "figure": table.take("figure", str), "x": table.take("x", str),
              "by": table.take("by", str), "label": table.take("label", str, ""), "log": table.take("log", bool, False),
              "where": table.take("where", dict, {}), "mean": table.take("mean", bool, False),
              "beside": table.take("beside", list, [])}
    table.done()
    for name in figure["cases"] or []:
        if name not in [case.name for case in cases]:
            table.fail("cases", f"{name!r} is no case")
    for name in {"bars": ("figure",), "lines": ("figure", "x")}.get(figure["kind"], ()):
        if figure[name] is None:
            table.fail(name, f"is missing: a figure of kind {figure['kind']!r} needs it")
    return figure


def read_toml(file: pathlib.Path) -> dict:
    try:
        return tomllib.loads(file.read_text())
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror}") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{file}: no TOML: {error}") from None


def read_published() -> dict:
    return read_toml(HERE / "published.toml")


def read_experiment(file: pathlib.Path, quick: bool = False) -> Experiment:
    """`quick`: with what [quick] puts in the place of the rest."""
    boxes = read_published()["box"]
    table = Table(file, "", read_toml(file))
    number = table.take("number", int, required=True)
    title, question = (table.take(name, str, required=True) for name in ("title", "question"))
    runs = table.choice("runs", OPTIONS, required=True)
    seeds = table.take("seeds", int, 10)
    short = Table(file, "quick", table.take("quick", dict, {}))
    common = options_of(file, "options", runs, table.take("options", dict, {}))
    matrix, tables = table.take("matrix", dict, {}), table.take("case", list, [])
    all_cases = cases_of(file, runs, common, matrix, tables, {}, boxes, matrix)
    quick_options = options_of(file, "quick.options", runs, short.take("options", dict, {}))
    quick_matrix = short.take("matrix", dict, {})
    quick_seeds = short.take("seeds", int, 1)
    named = short.take("cases", list)
    short.done()
    for name in named or []:
        if name not in [case.name for case in all_cases]:
            short.fail("cases", f"{name!r} is none of {', '.join(case.name for case in all_cases)}")
    for name in quick_matrix:
        if name not in matrix:
            short.fail(f"matrix.{name}", "is not in [matrix]")
    cases = all_cases
    if quick:
        seeds = quick_seeds
        cases = cases_of(file, runs, common, {**matrix, **quick_matrix}, tables, quick_options, boxes, matrix)
        cases = [case for case in cases if named is None or case.name in named]
    if seeds < 1:
        table.fail("seeds", f"{seeds} is below 1")
    bars = [bar_of(file, f"bar[{i}]", one, all_cases) for i, one in enumerate(table.take("bar", list, []))]
    figures = [figure_of(file, f"figure[{i}]", one, all_cases) for i, one in enumerate(table.take("figure", list, []))]
    notes = table.take("notes", list, [])
    table.done()
    return Experiment(file.stem, number, title, question, runs, seeds, cases, bars, figures, notes, quick)


def read_all(quick: bool = False) -> list[Experiment]:
    """In the order of their numbers."""
    return sorted((read_experiment(file, quick) for file in CONFIGS.glob("*.toml")), key=lambda one: one.number)
