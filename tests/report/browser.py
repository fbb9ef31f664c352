"""Headless Chromium over its DevTools pipe, with nothing but Python's own library.

    with Browser() as browser:
        page = browser.open("file:///tmp/report.html", width=1280, height=900)
        page.evaluate("document.title")

Chromium reads commands from file descriptor 3 and writes answers and events to 4, JSON ended by a zero byte.
"""

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time

LIMIT_S = 120


def find_chromium():
    return next((path for path in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if path), None)


class Browser:
    def __init__(self, *flags):
        self.profile = tempfile.mkdtemp(prefix="volalign_chromium_")
        to_browser, from_browser = os.pipe(), os.pipe()
        command = [find_chromium(), "--headless=new", "--remote-debugging-pipe", f"--user-data-dir={self.profile}", "--no-first-run",
                   "--disable-extensions", "--disable-background-networking", "--disable-dev-shm-usage", "--hide-scrollbars",
                   "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", *flags]
        if os.geteuid() == 0:
            command.append("--no-sandbox")

        def redirect():
            # Through high numbers, so that neither lands on the other's place.
            read, write = os.dup2(to_browser[0], 100), os.dup2(from_browser[1], 101)
            os.dup2(read, 3)
            os.dup2(write, 4)

        self.process = subprocess.Popen(command, preexec_fn=redirect, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(to_browser[0])
        os.close(from_browser[1])
        self.to, self.source = to_browser[1], from_browser[0]
        self.pending, self.events, self.count = b"", [], 0

    def __enter__(self):
        return self

    def __exit__(self, *ignored):
        try:
            self.send("Browser.close")
            self.process.wait(10)
        except (OSError, RuntimeError, subprocess.TimeoutExpired):
            self.process.kill()
            self.process.wait()
        shutil.rmtree(self.profile, ignore_errors=True)

    def message(self, deadline):
        while b"\0" not in self.pending:
            ready, _, _ = select.select([self.source], [], [], max(0, deadline - time.monotonic()))
            if not ready:
                raise RuntimeError(f"Chromium did not answer in {LIMIT_S} s")
            read = os.read(self.source, 1 << 20)
            if not read:
                raise RuntimeError("Chromium ended")
            self.pending += read
        text, self.pending = self.pending.split(b"\0", 1)
        return json.loads(text)

    def send(self, method, session=None, **parameters):
        self.count += 1
        call = {"id": self.count, "method": method, "params": parameters}
        if session:
            call["sessionId"] = session
        os.write(self.to, json.dumps(call).encode() + b"\0")
        deadline = time.monotonic() + LIMIT_S
        while True:
            message = self.message(deadline)
            if "id" not in message:
                self.events.append(message)
            elif message["id"] == self.count:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']['message']}")
                return message["result"]

    def open(self, url, width=1280, height=900, dark=False, mobile=False, scale=1):
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        return Page(self, target, session, url, width, height, dark, mobile, scale)


class Page:
    def __init__(self, browser, target, session, url, width, height, dark, mobile, scale):
        self.browser, self.target, self.session = browser, target, session
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=mobile)
        self.set_dark(dark)
        self.send("Page.navigate", url=url)
        self.wait("document.readyState === 'complete'")

    def send(self, method, **parameters):
        return self.browser.send(method, session=self.session, **parameters)

    def set_dark(self, dark):
        self.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])

    def evaluate(self, expression):
        answer = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def wait(self, condition):
        """Until the expression is true."""
        deadline = time.monotonic() + LIMIT_S
        while not self.evaluate(condition):
            if time.monotonic() > deadline:
                raise RuntimeError(f"not so within {LIMIT_S} s: {condition}")
            time.sleep(0.05)

    def close(self):
        self.browser.send("Target.closeTarget", targetId=self.target)

    def settle(self):
        """Until what was asked of the 3D view is drawn, which it is not in a page behind others."""
        self.send("Page.bringToFront")
        self.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 0))))")

    def press(self, key, code=None, text=None):
        names = {" ": "Space", "Tab": "Tab"}
        event = {"key": key, "code": code or names.get(key, key), "windowsVirtualKeyCode": {" ": 32, "Tab": 9}.get(key, 0)}
        self.send("Input.dispatchKeyEvent", type="keyDown", **event, **({"text": text} if text else {}))
        self.send("Input.dispatchKeyEvent", type="keyUp", **event)

    def drag(self, begin, end):
        button = {"button": "left", "buttons": 1, "clickCount": 1}
        self.send("Input.dispatchMouseEvent", type="mousePressed", x=begin[0], y=begin[1], **button)
        for share in (0.25, 0.5, 0.75, 1):
            x, y = (a + share * (b - a) for a, b in zip(begin, end))
            self.send("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, **button)
        self.send("Input.dispatchMouseEvent", type="mouseReleased", x=end[0], y=end[1], **button)

    def screenshot(self, selector=None, whole=False, until=None, **encoding):
        """PNG bytes, or what `encoding` (format, quality) asks for: of the window, of the whole page, of an element, or of the page up to the end of an element."""
        options = {}
        if selector:
            box = self.evaluate(f"(() => {{ const b = document.querySelector({json.dumps(selector)}).getBoundingClientRect(); "
                                "return {x: b.x + scrollX, y: b.y + scrollY, width: b.width, height: b.height}; })()")
            options = {"clip": {**box, "scale": 1}, "captureBeyondViewport": True}
        if whole or until:
            size = self.send("Page.getLayoutMetrics")["cssContentSize"]
            height = self.evaluate(f"document.querySelector({json.dumps(until)}).getBoundingClientRect().bottom + scrollY") if until else size["height"]
            options = {"clip": {"x": 0, "y": 0, "width": size["width"], "height": height, "scale": 1}, "captureBeyondViewport": True}
        return base64.b64decode(self.send("Page.captureScreenshot", **{"format": "png", **encoding}, **options)["data"])

    def complaints(self):
        """What the console and the log have against the page, and every request for anything but the file itself and data in it."""
        self.evaluate("0")
        found = []
        for event in self.browser.events:
            method, parameters = event["method"], event.get("params", {})
            if event.get("sessionId") != self.session:
                continue
            if method == "Runtime.exceptionThrown":
                found.append(parameters["exceptionDetails"]["text"] + " " + parameters["exceptionDetails"].get("exception", {}).get("description", ""))
            if method == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "warning", "assert"):
                found.append(" ".join(str(argument.get("value", argument.get("description"))) for argument in parameters["args"]))
            if method == "Log.entryAdded" and parameters["entry"]["level"] in ("error", "warning"):
                found.append(parameters["entry"]["text"])
            if method == "Network.requestWillBeSent" and not parameters["request"]["url"].startswith(("file:", "data:")):
                found.append("requests " + parameters["request"]["url"])
        return found
