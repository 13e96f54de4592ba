"""What the scripts here share: labkit on the path, and a place for the result."""

import json
import sys

root, output, *words = sys.argv[1:]
sys.path.append(root)


def write(result):
    with open(output, "w") as handle:
        json.dump(result, handle)
