"""Error over time: `python -m gpurt.chart SCENE --reference REF.exr -o DIR`.

Renders a scene with several settings, several seeds and growing numbers of samples, compares every picture with the
reference, and writes chart.csv, chart.json, chart.svg, chart.png and index.html.
"""
