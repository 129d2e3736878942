"""The style of a page: on a screen, on a phone, in dark mode, and on paper."""

from __future__ import annotations

STYLE = """
:root { color-scheme: light dark; --ink: #1b1f24; --paper: #fff; --line: #d8dee4; --head: #f3f5f7;
        --good: #116329; --bad: #a40e26; --neutral: #57606a; --faint: #656d76; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 68rem; margin: 2rem auto; padding: 0 1rem;
       color: var(--ink); background: var(--paper); overflow-wrap: anywhere; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
h3 { font-size: 1.05rem; margin-top: 1.6rem; }
a { color: inherit; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: .6rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .15rem .7rem; border-bottom: 1px solid var(--line); text-align: right; }
th, td { overflow-wrap: normal; } td.long { overflow-wrap: anywhere; }
th { background: var(--head); } th:first-child, td:first-child { text-align: left; }
td.text, th.text { text-align: left; }
tr.faint td { color: var(--faint); font-style: italic; }
figure { margin: .8rem 0; } figure svg { width: 100%; height: auto; max-width: 60rem; }
figcaption { color: var(--neutral); }
.head { display: grid; grid-template-columns: repeat(auto-fill, minmax(19rem, 1fr)); gap: 0 2rem;
        margin: 1rem 0; }
.head div { display: flex; gap: .7rem; border-bottom: 1px solid var(--line); padding: .15rem 0; }
.head dt { flex: 0 0 8.5rem; color: var(--neutral); } .head dd { margin: 0; flex: 1; }
.head .blank { min-height: 1.5em; }
.verdict { margin: 1.2rem 0; padding: .6rem 1.2rem; border: .35rem solid; border-radius: .4rem; }
.verdict b { display: block; font-size: clamp(2.2rem, 9vw, 4.5rem); line-height: 1.15; }
.key { font-size: 1.2rem; font-weight: 600; }
.good { color: var(--good); } .bad { color: var(--bad); } .neutral { color: var(--neutral); }
.sign { display: flex; flex-wrap: wrap; gap: 2.5rem; margin-top: 3.5rem; }
.sign div { flex: 1 1 14rem; border-top: 1px solid var(--ink); padding-top: .3rem; }
@media screen and (prefers-color-scheme: dark) {
  :root { --ink: #e6edf3; --paper: #0d1117; --line: #30363d; --head: #161b22;
          --good: #56d364; --bad: #ff7b72; --neutral: #9198a1; --faint: #9198a1; }
  figure svg { filter: invert(.9) hue-rotate(180deg); } }
@media print {
  :root { color-scheme: light; }
  body { font-size: 9.5pt; line-height: 1.35; max-width: none; margin: 0; padding: 0; }
  h1 { font-size: 15pt; margin: 0 0 2mm; } h2 { font-size: 11.5pt; margin: 4mm 0 1mm; }
  h3 { font-size: 10pt; margin: 3mm 0 1mm; }
  h2, h3 { break-after: avoid; } tr, figure, .verdict, .sign, .head { break-inside: avoid; }
  p, ul { margin: 1.5mm 0; } figure { margin: 2mm 0; } figcaption { font-size: 8pt; }
  .appendix { break-before: page; }
  .head { grid-template-columns: 1fr 1fr; gap: 0 6mm; margin: 2mm 0; font-size: 8.5pt; }
  .head dt { flex-basis: 28mm; }
  .verdict { margin: 2mm 0; padding: 2mm 4mm; border-width: 1mm; }
  .verdict b { font-size: 24pt; } .key { font-size: 11pt; margin: 1mm 0; }
  .sign { margin-top: 13mm; }
  thead { display: table-header-group; } .wide { overflow: visible; }
  table { font-size: 8pt; max-width: 100%; }
  th, td { padding: .1rem .3rem; overflow-wrap: break-word; } }
"""


def make_footer_style(left_text: str) -> str:
    """Make the style of a printed page's footer: *left_text*, the page and the number of pages.

    *left_text* is the arm's serial number.
    """
    return (
        "@page { size: A4; margin: 16mm 15mm 18mm;"
        f" @bottom-left {{ content: {_escape_css(left_text)}; font: 8pt sans-serif; }}"
        ' @bottom-right { content: "page " counter(page) " of " counter(pages);'
        " font: 8pt sans-serif; } }\n"
    )


def _escape_css(text: str) -> str:
    """Return a CSS string within HTML; every character but letters and digits is escaped."""
    safe = (
        letter if letter.isascii() and letter.isalnum() else f"\\{ord(letter):06x}"
        for letter in text
    )
    return f'"{"".join(safe)}"'
