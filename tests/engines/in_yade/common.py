"""Common to the scripts of this folder: puts labkit on the path and writes the result."""

import json
import sys

root, output, *arguments = sys.argv[1:]
sys.path.append(root)


def write(result):
    with open(output, "w") as handle:
        json.dump(result, handle)
