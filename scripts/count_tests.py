"""Prints 'N passed, N failed, N skipped' of a test run, from PREFIX.xml (JUnit) or PREFIX.log (cargo test).

Fails if no test ran.
"""

import pathlib
import re
import sys
import xml.etree.ElementTree


def from_junit(path):
    passed = failed = skipped = 0
    for case in xml.etree.ElementTree.parse(path).iter("testcase"):
        if case.find("failure") is not None or case.find("error") is not None or case.get("status") == "fail":
            failed += 1
        elif case.find("skipped") is not None or case.get("status") in ("notrun", "disabled"):
            skipped += 1
        else:
            passed += 1
    return passed, failed, skipped


def from_cargo(path):
    text = path.read_text(encoding="utf-8", errors="replace")
    found = re.findall(r"^test result: .*?(\d+) passed; (\d+) failed; (\d+) ignored", text, flags=re.M)
    return tuple(sum(int(row[i]) for row in found) for i in range(3))


def main():
    junit, log = (pathlib.Path(sys.argv[1] + suffix) for suffix in (".xml", ".log"))
    if junit.exists():
        counts = from_junit(junit)
    else:
        counts = from_cargo(log) if log.exists() else (0, 0, 0)
    print("{} passed, {} failed, {} skipped".format(*counts))
    return 0 if counts[0] + counts[1] else 1


if __name__ == "__main__":
    sys.exit(main())
