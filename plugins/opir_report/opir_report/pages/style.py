"""The style sheet of reports: light and dark, narrow and wide, and for print."""

from opir_report.palette import ROLES

_RULES = """
*, *::before, *::after { box-sizing: border-box; }
html { font: 16px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: var(--ink); background: var(--paper); }
body { margin: 0 auto; max-width: 62rem; padding: 1rem clamp(0.8rem, 3vw, 2rem) 3rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0.6rem 0 0.2rem; }
h2 { font-size: 1.25rem; margin: 2.2rem 0 0.5rem; border-top: 1px solid var(--grid); padding-top: 1rem; }
p, figcaption, caption { max-width: 48rem; }
header p, footer p, figcaption, caption { color: var(--muted); margin: 0.3rem 0; }
figcaption, caption, footer { font-size: 0.9rem; text-align: left; }
a { color: var(--link); text-underline-offset: 2px; }
a:focus-visible, .scroll:focus-visible { outline: 2px solid var(--link); outline-offset: 2px; }
nav ol { display: flex; flex-wrap: wrap; gap: 0.2rem 1.2rem; list-style: none; margin: 1rem 0; padding: 0; }
.summary { background: var(--sea); border-left: 4px solid var(--s1); margin: 1rem 0; padding: 0.7rem 1rem 0.7rem 2rem; }
.summary li { margin: 0.25rem 0; }
figure { margin: 1.2rem 0 1.8rem; }
figure svg { display: block; width: 100%; height: auto; font-family: "DejaVu Sans", Verdana, sans-serif; }
figure svg * { stroke-linejoin: round; stroke-linecap: butt; }
.scroll { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: 0.9rem; font-variant-numeric: tabular-nums; }
th, td { border-bottom: 1px solid var(--grid); padding: 0.25rem 1.1rem 0.25rem 0; text-align: left; }
td.n { text-align: right; white-space: nowrap; }
tbody th { font-weight: normal; white-space: nowrap; }
caption { padding-bottom: 0.3rem; }
@media (max-width: 40rem) { figure svg { min-width: 38rem; } }
@media print {
  body { max-width: none; padding: 0; }
  nav { display: none; }
  figure, table, .summary { break-inside: avoid; }
  h2 { break-after: avoid; }
  .scroll { overflow: visible; }
  figure svg { min-width: 0; }
}
"""


def style_sheet() -> str:
    """Return the style sheet; print is always light."""
    light = " ".join(f"--{name}: {colour};" for colour, (name, _) in ROLES.items())
    dark = " ".join(f"--{name}: {colour};" for name, colour in ROLES.values())
    return (
        f":root {{ {light} --link: #0b5c94; }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark} --link: #8cc8f5; }}"
        f" }}{_RULES}"
    )
