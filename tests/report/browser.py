"""Headless Chromium, driven by Selenium.

    with Browser() as browser:
        page = browser.open("file:///tmp/report.html", width=1280, height=900)
        page.evaluate("document.title")
"""

import base64
import json
import os
import shutil

from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.wait import WebDriverWait

LIMIT_S = 120


class Browser:
    def __init__(self, *flags):
        options = webdriver.ChromeOptions()
        for flag in ("--headless=new", "--no-first-run", "--disable-extensions", "--disable-background-networking", "--disable-dev-shm-usage",
                     "--hide-scrollbars", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", *flags):
            options.add_argument(flag)
        if os.geteuid() == 0:
            options.add_argument("--no-sandbox")
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(service=Service(shutil.which("chromedriver")), options=options)

    def __enter__(self):
        return self

    def __exit__(self, *ignored):
        self.driver.quit()

    def open(self, url, width=1280, height=900, dark=False, mobile=False):
        self.driver.switch_to.new_window("tab")
        return Page(self.driver, url, width, height, dark, mobile)


class Page:
    def __init__(self, driver, url, width, height, dark, mobile):
        self.driver, self.window = driver, driver.current_window_handle
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)
        self.set_dark(dark)
        driver.get(url)
        self.wait("document.readyState === 'complete'")

    def send(self, method, **parameters):
        """A command of the DevTools protocol."""
        if self.driver.current_window_handle != self.window:
            self.driver.switch_to.window(self.window)
        return self.driver.execute_cdp_cmd(method, parameters)

    def set_dark(self, dark):
        self.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])

    def evaluate(self, expression):
        answer = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def wait(self, condition):
        """Until the expression is true."""
        WebDriverWait(self.driver, LIMIT_S, 0.05).until(lambda driver: self.evaluate(condition), condition)

    def close(self):
        self.send("Page.close")
        self.driver.switch_to.window(self.driver.window_handles[0])

    def settle(self):
        """Until what was asked of the 3D view is drawn, which it is not in a page behind others."""
        self.send("Page.bringToFront")
        self.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 0))))")

    def press(self, key):
        self.settle()
        ActionChains(self.driver).send_keys(key).perform()

    def drag(self, begin, end):
        self.settle()
        actions = ActionBuilder(self.driver)
        actions.pointer_action.move_to_location(*map(int, begin)).pointer_down().move_to_location(*map(int, end)).pointer_up()
        actions.perform()

    def screenshot(self, selector):
        """PNG bytes of an element."""
        box = self.evaluate(f"(() => {{ const b = document.querySelector({json.dumps(selector)}).getBoundingClientRect(); "
                            "return {x: b.x + scrollX, y: b.y + scrollY, width: b.width, height: b.height}; })()")
        return base64.b64decode(self.send("Page.captureScreenshot", clip={**box, "scale": 1}, captureBeyondViewport=True)["data"])

    def complaints(self):
        """What the console and the log have against the browser's pages since the last call, and every request for anything but files and data in them."""
        found = [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]
        for entry in self.driver.get_log("performance"):
            event = json.loads(entry["message"])["message"]
            if event["method"] == "Network.requestWillBeSent" and not event["params"]["request"]["url"].startswith(("file:", "data:")):
                found.append("requests " + event["params"]["request"]["url"])
        return found
