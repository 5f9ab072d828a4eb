"""Who sits at the page in a real browser."""

import re

LONGEST = 240_000
"""Milliseconds that anything on the page may take on a machine that is busy with other tests."""


class Person:
    """Who clicks, and what the page shows; anything that the page asks of another host is noted."""

    def __init__(self, browser, address):
        self.context = browser.new_context(viewport={"width": 1280, "height": 900}, accept_downloads=True)
        self.page = self.context.new_page()
        self.page.set_default_timeout(LONGEST)
        self.wrong: list[str] = []
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("console", lambda line: self.wrong.append(line.text) if line.type == "error" else None)
        self.page.on("response", lambda own: self.wrong.append(f"{own.status} {own.url}") if not own.ok else None)
        self.page.on("request", lambda request: self._see(request.url, address))
        self.page.goto(address)
        self.settled()

    def _see(self, url, address):
        if not url.startswith((address.rsplit("/", 2)[0], "blob:", "data:")):
            self.wrong.append(f"asked for {url}")

    def settled(self):
        """Wait until all charts and the map are those of the present step."""
        for chart in ("overlay", "responses", "lines"):
            self.page.wait_for_selector(f"#training-{chart} .plot-container")
        self.page.wait_for_selector("#job", state="hidden")
        self.page.wait_for_selector(".stale", state="detached")

    def steps(self, count):
        self.page.wait_for_selector(f"#steps tbody tr:nth-child({count})")
        self.page.wait_for_selector(f"#steps tbody tr:nth-child({count + 1})", state="detached")
        self.settled()

    def slide(self, parameter):
        """Move a slider by keys and let it go; milliseconds of its answers."""
        self.page.focus(f"input[type=range][aria-label='{parameter}']")
        for _ in range(6):
            self.page.keyboard.press("ArrowRight")
            self.page.wait_for_timeout(150)  # it is not let go yet
        answers = """performance.getEntriesByType("resource").filter((own) => own.name.includes("/preview"))
            .map((own) => own.duration)"""
        self.page.wait_for_function(f"{answers}.length > 0")
        return self.page.evaluate(answers)

    def misfits(self):
        return [float(re.match(r"[\d.e+]+", self.page.inner_text(at))[0]) for at in ("#misfit", "#validation")]

    def take_away(self, button, path):
        with self.page.expect_download() as download:
            self.page.click(button)
        download.value.save_as(path)
        return path


def number(text):
    """What a cell of the map says, such as 12k; 0 where it says nothing."""
    return float(text.removesuffix("k")) * (1e3 if text.endswith("k") else 1.0) if text[0].isdigit() else 0.0
