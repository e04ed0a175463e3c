"""The HTML around a page's body: head, policy, style sheet, title and footer. Nothing is
fetched.
"""

from html import escape

from opir_report.pages.style import style_sheet


def html_page(
    title: str, subtitle: str, body: str, footer: str, *, style: str = "", scripts: str = ""
) -> str:
    """Return a self-contained page of a body, HTML; the other texts are plain, `style` is CSS added
    to that of reports.

    `scripts` are whole elements after the body; without any no script is allowed to run.
    """
    allowed = " script-src 'unsafe-inline';" if scripts else ""
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline';{allowed} \
img-src data:; base-uri 'none'; form-action 'none'">
<meta name="color-scheme" content="light dark">
<meta name="referrer" content="no-referrer">
<title>{escape(title)}</title>
<style>{style_sheet()}{style}</style>
</head>
<body>
<header>
<h1>{escape(title)}</h1>
<p>{escape(subtitle)}</p>
</header>
{body}
<footer><p>{escape(footer)}</p></footer>
{scripts}</body>
</html>
"""
