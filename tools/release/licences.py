"""Which crates the program holds, and their licences."""

import re
from pathlib import Path

NAMES = re.compile(r"(licen[cs]e|copying|copyright|notice|unlicense)", re.IGNORECASE)
DEBIAN = """\
Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: drystone
Comment: The program holds code of other crates; THIRD-PARTY-LICENCES.txt beside this file has their licences.

Files: *
Copyright: 2026, The drystone contributors
License: Expat or Apache-2.0

License: Expat
{mit}

License: Apache-2.0
 The text is in /usr/share/common-licenses/Apache-2.0.
"""


def linked_crates(metadata, tree):
    """Packages of `cargo metadata` that become part of the program: those in the lines of `cargo tree`, without itself.

    The metadata alone name too much: crates behind features that are off.
    """
    linked = {" ".join(line.split()[:2]) for line in tree.splitlines()}
    is_linked = lambda package: f"{package['name']} v{package['version']}" in linked
    packages = [package for package in metadata["packages"] if package["source"] and is_linked(package)]
    return sorted(packages, key=lambda package: (package["name"], package["version"]))


def without_unused(bill, tree):
    """An SBOM without the crates that are not among the lines of `cargo tree`."""
    used = {" ".join(line.split()[:2]) for line in tree.splitlines()}
    is_used = lambda component: f"{component['name']} v{component['version']}" in used
    references = {component["bom-ref"] for component in bill["components"] if is_used(component)}
    references.add(bill["metadata"]["component"]["bom-ref"])
    bill["components"] = list(filter(is_used, bill["components"]))
    bill["dependencies"] = [node for node in bill["dependencies"] if node["ref"] in references]
    for node in bill["dependencies"]:
        node["dependsOn"] = [reference for reference in node.get("dependsOn", []) if reference in references]
    return bill


def texts(package):
    """Files of a crate that hold its licence."""
    folder = Path(package["manifest_path"]).parent
    named = {path for path in folder.iterdir() if path.is_file() and NAMES.search(path.name)}
    if package.get("license_file"):
        named.add(folder / package["license_file"])
    return [path.read_text(encoding="utf-8", errors="replace").strip() for path in sorted(named)]


def title(package):
    return f"{package['name']} {package['version']}"


def notices(packages):
    """The crates with the names of their licences, then each text once, below the crates that it belongs to."""
    lines = ["The program holds code of the standard library of Rust (MIT OR Apache-2.0) and of these crates:", ""]
    lines += [f"  {title(package)}: {package['license'] or 'see below'}" for package in packages]
    owners = {}
    for package in packages:
        # Texts that differ in blanks alone are one.
        for words, text in {" ".join(text.split()): text for text in texts(package)}.items():
            owners.setdefault(words, (text, []))[1].append(title(package))
    for text, names in owners.values():
        lines += ["", "-" * 100, ", ".join(names), "", text]
    lacking = [package for package in packages if not texts(package)]
    if lacking:
        lines += ["", "-" * 100, "These crates come without the text of their licence:", ""]
        lines += [f"  {title(package)}: {package['license']}, by {', '.join(package['authors'])}" for package in lacking]
    return "\n".join(lines) + "\n"


def debian_copyright():
    text = (Path(__file__).resolve().parents[2] / "LICENSE-MIT").read_text(encoding="utf-8")
    body = text.strip().split("\n\n", 2)[2]
    return DEBIAN.format(mit="\n".join(f" {line}" if line else " ." for line in body.splitlines()))
