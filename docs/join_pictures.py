"""Joins pictures to one: the first on top, the others in a row below. scripts/demo --readme calls it."""

import argparse

from PIL import Image

GAP = 4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("top")
    parser.add_argument("row", nargs="+")
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--width", type=int, default=656)
    args = parser.parse_args()

    top = Image.open(args.top).convert("RGB")
    row = [Image.open(path).convert("RGB") for path in args.row]
    top = top.resize((args.width, round(args.width * top.height / top.width)), Image.Resampling.LANCZOS)
    # All of one height, and together as wide as the first.
    height = round((args.width - GAP * (len(row) - 1)) / sum(image.width / image.height for image in row))
    joined = Image.new("RGB", (args.width, top.height + GAP + height), "white")
    joined.paste(top, (0, 0))
    x = 0
    for i, image in enumerate(row):
        width = args.width - x if i == len(row) - 1 else round(height * image.width / image.height)
        joined.paste(image.resize((width, height), Image.Resampling.LANCZOS), (x, top.height + GAP))
        x += width + GAP
    # Noise does not compress, and the lowest bit of eight is noise here.
    joined = joined.point([round(round(x * 127 / 255) * 255 / 127) for x in range(256)] * 3)
    joined.save(args.output, optimize=True)


if __name__ == "__main__":
    main()
