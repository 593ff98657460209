"""Chromium without a screen, driven by Selenium: one for a module's tests."""

import contextlib
import shutil
import time

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

DESKTOP, PHONE = (1440, 900), (390, 844)
# In a container Chromium's own sandbox and /dev/shm are not to be had.
_FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage")


@contextlib.contextmanager
def chromium():
    """A browser, gone with the block."""
    options = Options()
    options.binary_location = shutil.which("chromium")
    for flag in _FLAGS:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options, Service(shutil.which("chromedriver")))
    try:
        yield Browser(driver)
    finally:
        driver.quit()


class Browser:
    """What a person does and sees."""

    def __init__(self, driver):
        self.driver = driver

    def open(self, url, size=DESKTOP, scheme="light"):
        """A page, as large as a screen and in a scheme."""
        self.driver.get("about:blank")  # a new token behind the # alone would load nothing
        self.size(*size)
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
        self.driver.get(url)

    def size(self, width, height):
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 700}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def script(self, code, *arguments):
        return self.driver.execute_script(code, *arguments)

    def text(self, name):
        return self.script("return document.getElementById(arguments[0]).textContent", name)

    def until(self, told, limit_s=10.0):
        """Wait until a function says something true; what it says."""
        end_s = time.monotonic() + limit_s
        while not (said := told()):
            assert time.monotonic() < end_s, f"after {limit_s} s it was still {said!r}"
            time.sleep(0.03)
        return said

    def press(self, *keys):
        """Keys, to whatever has the focus."""
        self.driver.switch_to.active_element.send_keys(*keys)

    def click(self, name):
        self.driver.find_element("id", name).click()

    def complaints(self):
        """What the console has heard since the last time, connections refused left out."""
        heard = [entry["message"] for entry in self.driver.get_log("browser")]
        return [line for line in heard if "WebSocket connection" not in line]
