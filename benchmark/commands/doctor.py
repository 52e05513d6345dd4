"""``focalpick doctor``."""

from __future__ import annotations


def doctor() -> int:
    """Check that everything focalpick needs is there and say what to do where it is not.

    Looks at OpenGL, the versions of the libraries, the parts' files, the taught vision models, and the disk. Exit
    code 0 when all is well, 1 otherwise.

    Example: focalpick doctor
    """
    from rich.markup import escape

    from benchmark.commands.common import make_console
    from benchmark.doctor import examine

    console = make_console(highlight=False, soft_wrap=True)
    findings = []
    for finding in examine():
        mark = "[green]ok     [/]" if finding.ok else "[bold red]problem[/]"
        remedy = "" if finding.ok or not finding.remedy else f". {finding.remedy}"
        console.print(f"{mark}  {escape(finding.subject)}: {escape(finding.text + remedy)}")
        findings.append(finding)
    problems = sum(not finding.ok for finding in findings)
    console.print(f"{problems} problems" if problems else "everything is there")
    return 1 if problems else 0
