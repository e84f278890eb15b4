"""One page of all experiments under a directory: self-contained, opens without a network."""
import base64
import html
import pathlib
import sys
import time

import config
import figures
import store

STYLE = config.STYLE + """
  img { max-width: 100%; background: #fff; border-radius: 6px; } section { margin: 26px 0; }
  .kept { color: var(--good); font-weight: 600; } .missed { color: var(--bad); font-weight: 600; }
  .not-measured { color: var(--soft); }
  td.text, th.text { text-align: left; white-space: normal; } h3 { font-size: 13.5px; margin: 16px 0 4px; }
"""
COLUMNS = (("two_way_ms.q1", "two-way q1, ms"), ("two_way_ms.median", "median"), ("two_way_ms.q3", "q3"),
           ("two_way_ms.p99", "p99"), ("age_ms.median", "age median, ms"), ("rms_m", "error rms, m"), ("max_m", "max, m"),
           ("lap_s", "lap, s"), ("top_speed_mps", "top speed, m/s"), ("top_lap_mps", "fastest lap's mean, m/s"),
           ("top_peak_mps", "its peak, m/s"), ("failed_at_mps", "failed at, m/s"), ("unfailed_to_mps", "nothing failed up to, m/s"),
           ("slowed_to_mps", "slowed to, m/s"), ("messages_per_s", "msg/s"), ("commands_per_block", "commands a block"),
           ("cpu_percent.all", "CPU, %"), ("finished", "finished"))
EXCHANGE_COLUMNS = (("ms.q1", "q1, ms"), ("ms.median", "median"), ("ms.q3", "q3"), ("ms.p99", "p99"), ("lost_percent", "lost, %"),
                    ("cpu_percent", "CPU, %"), ("top_speed_mps", "top speed, m/s"))
HOW = """Two-way latency is from the moment a state is sampled until the command made from it is verified on board and
ready for playout; age at application until its setpoint is sent to the drone, with the wait that playout adds on purpose.
Both are differences of one clock, that of the drone's host: the state's stamp goes to the ground and comes back in the command.
The clocks of two hosts are never compared, so no one-way latency is given. Errors are distances of the simulator's true
position from the path. Boxes are quartiles and median, whiskers reach to the farthest value within 1.5 boxes (Tukey). Where a
table has three numbers they are the median of the repetitions, and the lowest and highest. Drones are simulated, gusts are on;
on one machine all programs share its cores, and between them is loopback: the published ones had Wi-Fi and a machine each."""


def escape(text) -> str:
    return html.escape(str(text))


def number(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def spread(one: dict | None) -> str:
    if one is None:
        return "–"
    if one["count"] == 1 or one["low"] == one["high"]:
        return number(one["median"])
    return f"{number(one['median'])} <small>({number(one['low'])} to {number(one['high'])})</small>"


def row(cells, tag: str = "td", text: int = 1) -> str:
    """`text`: how many cells are text; the others are numbers."""
    one = lambda i, cell: f"<{tag}{' class=text' if i < text else ''}>{cell}</{tag}>"
    return f"<tr>{''.join(one(i, cell) for i, cell in enumerate(cells))}</tr>"


def table(rows: list[str]) -> str:
    return f'<div class="scroll"><table>{"".join(rows)}</table></div>'


def bars_table(document: dict) -> str:
    if not document["bars"]:
        return ""
    rows = [row(("bar", "", "wanted", "measured", ""), "th", 2)]
    for bar in document["bars"]:
        sign = "≤" if bar["rule"] == "at_most" else "≥"
        verdict = f'<span class="{bar["verdict"].replace(" ", "-")}">{bar["verdict"]}</span>'
        rows.append(row((escape(bar["what"]), verdict, f"{sign} {bar['limit']:g}", spread(bar["values"]), escape(bar["note"])),
                        text=2))
    return table(rows)


def exchange_table(document: dict) -> str:
    names = dict.fromkeys(name[:-len(".ms.median")] for spreads in document["spread"].values() for name in spreads
                          if name.endswith(".ms.median"))
    rows = [row(("case", "client, msg/s", *(title for _, title in EXCHANGE_COLUMNS)), "th", 2)]
    for case, spreads in document["spread"].items():
        for name in names:
            if f"{name}.ms.median" in spreads:
                figures = (spread(spreads.get(f"{name}.{key}")) for key, _ in EXCHANGE_COLUMNS)
                rows.append(row((escape(case), escape(" at ".join(name.rsplit(".", 1))), *figures), text=2))
    return table(rows)


def cases_table(document: dict) -> str:
    if document["asked"]["runs"] == "exchange":
        return exchange_table(document)
    columns = [(key, title) for key, title in COLUMNS if any(key in spreads for spreads in document["spread"].values())]
    rows = [row(("case", "n", *(title for _, title in columns)), "th")]
    for case, spreads in document["spread"].items():
        rows.append(row((escape(case), len(document["cases"][case]), *(spread(spreads.get(key)) for key, _ in columns))))
    return table(rows)


def section(document: dict, drawn: list[tuple[str, pathlib.Path]]) -> str:
    asked, machine = document["asked"], document["machine"]
    where = f"ledger: {asked['ledger']}, on {asked['storage']} where a case says nothing else"
    if asked["runs"] == "sitl":
        where = "simulated time"
    parts = [f'<section class="card" id="{document["experiment"]}"><h2>{document["number"]}. {escape(document["title"])}</h2>',
             f"<p>{escape(document['question'])}</p>",
             f"<p>{escape(where)}; {asked['seeds']} repetition{'s' if asked['seeds'] > 1 else ''} of each case"
             f"{' (a quick look, not a result)' if asked['quick'] else ''}; {machine['cores']} × {escape(machine['cpu'])}, "
             f"{machine['memory_gb']:g} GB, {escape(machine['system'])}, load before {machine['load_before']:g}; "
             f"programs {document['programs']}; {document['seconds']:.0f} s</p>",
             bars_table(document), "<h3>Figures</h3>", cases_table(document)]
    notes = document["notes"] + [f"{case}: {why}" for case, why in document["left_out"].items()]
    notes += [f"not measured: {one['case']}, seed {one['seed']}: {one['why']}" for one in document["not_measured"]]
    if notes:
        parts.append("<ul>" + "".join(f"<li>{escape(note)}</li>" for note in notes) + "</ul>")
    for title, file in drawn:
        data = base64.b64encode(file.read_bytes()).decode()
        parts.append(f'<h3>{escape(title)}</h3><img alt="{escape(title)}" src="data:image/png;base64,{data}">')
    return "\n".join(parts) + "</section>"


def contradictions(published: dict) -> str:
    rows = [row(("published", "and also", "why both cannot be", "here"), "th", 4)]
    rows += [row([escape(one[key]) for key in ("one", "other", "why", "ours")], text=4) for one in published["contradiction"]]
    return f'<section class="card"><h2>Where published statements contradict each other</h2>{table(rows)}</section>'


def published_table(published: dict) -> str:
    rows = [row(("published two-way latency, s", "low", "q1", "median", "q3", "high", "setting"), "th")]
    rows += [row((escape(name), *(f"{box[key]:.3f}" for key in ("low", "q1", "median", "q3", "high")), escape(box["setting"])))
             for name, box in published["box"].items()]
    more = [row(("published exchange", "states/s", "msg/s", "latency, s", "top speed, m/s", "CPU"), "th")]
    more += [row((escape(one["way"]), one["rate_hz"], one["messages_per_s"], one.get("latency", "–"), one.get("speed", "–"),
                  escape(one["cpu"]))) for one in published["exchange"]]
    return (f'<section class="card"><h2>What is published</h2><p>{escape(published["setting"])}</p>{table(rows)}{table(more)}'
            "</section>")


def read_documents(out: pathlib.Path) -> dict[str, dict]:
    found = {}
    for file in sorted(out.glob("*.json")):
        document = store.read(file)
        if not isinstance(document, dict) or document.get("format") != store.FORMAT:
            print(f"{file}: no experiment of this version; not in the page", file=sys.stderr)
        else:
            found[document["experiment"]] = document
    return dict(sorted(found.items(), key=lambda item: item[1]["number"]))


def write(out: pathlib.Path) -> pathlib.Path:
    """Figures, experiments.png and report.html, from the JSON that is there."""
    published, documents = config.read_published(), read_documents(out)
    sections = [section(document, figures.draw(document, published, out / "figures")) for document in documents.values()]
    figures.overview(documents, published, out / "experiments.png")
    summary = [row(("experiment", "repetitions", "bars kept", "missed", "not measured"), "th")]
    for document in documents.values():
        verdicts = [bar["verdict"] for bar in document["bars"]]
        summary.append(row((f'<a href="#{document["experiment"]}">{document["number"]}. {escape(document["title"])}</a>',
                            sum(map(len, document["cases"].values())),
                            *(verdicts.count(one) for one in ("kept", "missed", "not measured")))))
    page = out / "report.html"
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>Ledgerline experiments</title><style>{STYLE}</style></head><body><main>
<header><h1>Ledgerline: experiments</h1></header><p class="sub">{time.strftime('%Y-%m-%d %H:%M')}</p>
{table(summary)}
{"".join(sections)}
<section class="card"><h2>How ours is measured</h2><p>{escape(HOW)}</p></section>
{contradictions(published)}
{published_table(published)}
</main></body></html>
""")
    return page
