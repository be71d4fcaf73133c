"""Makes the tables of the steps: their commands and CPU hours."""

from reproduction import RECORDED, ROOT, engine
from reproduction.steps import OTHERS, STEPS
from reproduction.tables.common import Rows, markdown, with_heads


@with_heads("file", "command", "parts", "CPU h", "source")
def steps() -> Rows:
    """Returns a row for each command, and the sum."""
    record = engine.recorded(engine.Places(RECORDED, ROOT / "out/steps"))
    took = (record.groupby("command").cpu_s.last() / 3600).to_dict()
    total, secondary = 0.0, 0.0
    for step in STEPS:
        for command in step.commands:
            words = command.words.replace("{", "results/").replace("}", "")
            parts = engine.typed(command)
            known = set(parts) <= set(took)
            hours = sum(took[part] for part in parts) if known else command.cpu_h
            source = "recorded" if known else command.source
            yield [f"`{step.name}`", f"`{words}`", str(len(parts)), f"{hours:.2g}", source]
            total += hours
            secondary += hours * command.secondary
    yield ["**all**", "", "", f"**{total:.1f}**", ""]
    yield ["**all with `--primary`**", "", "", f"**{total - secondary:.1f}**", ""]


def others() -> str:
    return markdown(["file", "how it is made"], [[f"`{n}`", how] for n, how in OTHERS.items()])
