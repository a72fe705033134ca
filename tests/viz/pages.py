"""The elements of a page, and the data of a report in it."""

import html.parser
import json

from qtraj.viz.report import report_page


class Page(html.parser.HTMLParser):
    """The elements of a page, as a browser sees them."""

    def __init__(self, text):
        super().__init__()
        self.scripts, self.text, self.attributes, self.inside = [], [], [], None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.inside = tag
        self.attributes += [(tag, name, value) for name, value in attrs]
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag):
        self.inside = None

    def handle_data(self, data):
        if self.inside == "script":
            self.scripts[-1] += data
        else:
            self.text.append(data)


def shown_panels(dataset):
    """The panels of a page by their titles."""
    return {panel["title"]: panel for panel in json.loads(Page(report_page(dataset)).scripts[0])["panels"]}
