"""Makes a Foxglove layout for the MCAP recordings of a body.

    arnold-analyze inspect RECORDING.mcap --json | python3 scripts/foxglove_layout.py > data/foxglove/BODY.json

Foxglove wants every line of a plot by its path, `/activation.value."ECRL"`, so a layout belongs to a body. Each quantity
becomes one plot; those of muscles stand in the left column. Reward components are left out: they belong to a task.
"""

import json
import sys

PLOTS = [
    # name, title, column
    ("activation", "Muscle activation", 0),
    ("action_mean", "Action before projection and noise", 0),
    ("action", "Action sent to the body", 0),
    ("joint", "Joints", 1),
    ("foot_contact", "Touch forces", 1),
    ("reward", "Reward", 1),
    ("solved", "Solved", 1),
]


def plot(channel, title):
    def path(element):
        name = element["name"]
        return f"/{channel['name']}.value" + (f'."{name}"' if name else "")

    lines = [
        {
            "value": path(element),
            "label": element["name"] or channel["name"],
            "enabled": True,
            "timestampMethod": "receiveTime",
        }
        for element in channel["elements"]
    ]
    return {
        "title": title,
        "paths": lines,
        "xAxisVal": "timestamp",
        "isSynced": True,
        "showLegend": len(lines) <= 8,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showPlotValuesInLegend": False,
        "sidebarDimension": 240,
    }


def stacked(panels, direction):
    """One panel after the other, each with its share of the room."""
    if len(panels) == 1:
        return panels[0]
    share = 100 / len(panels)
    rest = stacked(panels[1:], direction)
    return {"first": panels[0], "second": rest, "direction": direction, "splitPercentage": share}


def main():
    channels = {channel["name"]: channel for channel in json.load(sys.stdin)["channels"]}
    panels, columns = {}, ([], [])
    for name, title, column in PLOTS:
        if name in channels:
            panels[f"Plot!{name}"] = plot(channels[name], title)
            columns[column].append(f"Plot!{name}")
    layout = stacked([stacked(column, "column") for column in columns], "row")
    document = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 0.5},
        "layout": layout,
    }
    json.dump(document, sys.stdout, indent=1)
    sys.stdout.write("\n")


main()
