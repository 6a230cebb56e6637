"""Command lines of Ray and MLflow, which click parses, understood without being run."""

from __future__ import annotations

from collections.abc import Sequence

import click


def click_context(command: click.Command, words: Sequence[str]) -> click.Context:
    """What click understands of a command line; nothing is run.

    Raises:
        click.UsageError: it does not understand it.
    """
    context = command.make_context(words[0], list(words[1:]))
    while isinstance(command, click.Group):
        rest = [*getattr(context, "_protected_args", ()), *context.args]
        name, found, rest = command.resolve_command(context, rest)
        assert found is not None
        command, context = found, found.make_context(name, rest, parent=context)
    return context


def ray(words: Sequence[str]) -> click.Context:
    """A command line of Ray, understood."""
    from ray.scripts.scripts import cli as command

    return click_context(command, words)


def mlflow(words: Sequence[str]) -> click.Context:
    """A command line of MLflow, understood."""
    from mlflow.cli import cli as command

    return click_context(command, words)
