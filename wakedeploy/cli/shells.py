"""What shells are answered at Tab, where click's answer would be wrong: --option=VALUE, commas."""

from typing import Any

from click.shell_completion import (
    BashComplete,
    CompletionItem,
    FishComplete,
    ShellComplete,
    ZshComplete,
    add_completion_class,
)


class _WithOption(ShellComplete):
    """Answers `--arch=g` with `--arch=gru`, for what is answered takes the whole word's place."""

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem[str]]:
        """The completions of a word."""
        found = super().get_completions(args, incomplete)
        option, equals, _ = incomplete.partition("=")
        if not (equals and option.startswith("--")):
            return found
        return [_behind(option + equals, item) for item in found]


class _Bash(_WithOption, BashComplete):
    """Bash cuts a word at each `=`, which is then a word of its own."""

    def get_completion_args(self) -> tuple[list[str], str]:
        """The words before the one to complete, and that one."""
        args, incomplete = super().get_completion_args()
        return (args[:-1] if args[-1:] == ["="] else args), incomplete


class _Zsh(_WithOption, ZshComplete):
    """Zsh takes the place of the whole word."""


class _Fish(_WithOption, FishComplete):
    """Fish would cut values and descriptions at their commas."""

    source_template = FishComplete.source_template.replace(
        'string split ","', 'string split --max 1 ","'
    )


def register() -> None:
    """Answer shells in this way."""
    for shell in (_Bash, _Zsh, _Fish):
        add_completion_class(shell)


def _behind(option: str, item: CompletionItem[Any]) -> CompletionItem[Any]:
    """The item behind its option; a shell completes files by itself."""
    if item.type != "plain" or str(item.value).startswith(option):
        return item
    return CompletionItem(f"{option}{item.value}", type=item.type, help=item.help)
