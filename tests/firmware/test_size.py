"""The sketch compiles without the Arduino IDE and leaves the UNO room."""

import needs

from runtime.virtual.firmware_build import firmware

pytestmark = needs.avr_compiler

MOST_FLASH_BYTES = 8 * 1024  # of 31.5 KiB; less than 8 KiB are used
MOST_RAM_BYTES = 512  # of 2 KiB, the stack not counted; the deepest call takes about 200 more


def test_flash_and_ram_stay_below_their_ceilings():
    built = firmware()
    assert 2000 < built.flash_bytes <= MOST_FLASH_BYTES
    assert 100 < built.ram_bytes <= MOST_RAM_BYTES
    assert built.hex.read_text().startswith(":10000000")
