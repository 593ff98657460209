"""The sketch compiles without the Arduino IDE and leaves the UNO room."""

import needs

from runtime.virtual.firmware_build import MOST_FLASH_BYTES, MOST_RAM_BYTES, firmware

pytestmark = needs.avr_compiler


def test_flash_and_ram_stay_below_their_ceilings():
    built = firmware()
    assert 2000 < built.flash_bytes <= MOST_FLASH_BYTES
    assert 100 < built.ram_bytes <= MOST_RAM_BYTES
    assert built.hex.read_text().startswith(":10000000")
