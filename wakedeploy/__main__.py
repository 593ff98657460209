"""`python -m wakedeploy` is the command `wakedeploy`."""

from wakedeploy.cli import main

main(prog_name="wakedeploy")
