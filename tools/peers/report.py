"""From the turns' times to figures, and to text."""
import statistics

import networks


def spread(values):
    """Median, smallest and largest."""
    return {"median": statistics.median(values), "low": min(values), "high": max(values)}


def row(turns):
    """Figures of a peer from its turns: ms of a frame and of its stages."""
    stages = {name: statistics.median(turn["stages"][name] for turn in turns) for name in turns[0]["stages"]}
    return {"ms": spread([turn["ms"] for turn in turns]), "stages": stages, "rounds": [turn["ms"] for turn in turns],
            "others": statistics.median(turn["others"] for turn in turns)}


def ratio(rows, name, other):
    """Time of one peer over another's, round by round."""
    return spread([a / b for a, b in zip(rows[name]["rounds"], rows[other]["rounds"])])


def ratios(rows, references):
    """{peer: {reference: spread}} of all peers that ran, over the references that ran."""
    return {name: {other: ratio(rows, name, other) for other in references if other in rows and other != name}
            for name in rows}


def table(header, lines):
    """Columns as wide as their widest cell; the first to the left, the others to the right."""
    widths = [max(len(line[i]) for line in [header, *lines]) for i in range(len(header))]
    return "\n".join("  ".join([line[0].ljust(widths[0])] + [cell.rjust(width) for cell, width in
                                                             zip(line[1:], widths[1:])]).rstrip()
                     for line in [header, *lines])


def text(result):
    """What bench_peers prints."""
    host, rows, references = result["host"], result["peers"], result["references"]
    lines = [f"{host['cpu']}, {host['threads']} threads on cores {', '.join(map(str, host['cores']))}",
             f"{result['size']}, {result['frames']} frames, {result['iterations']} iterations, "
             f"{result['rounds']} rounds; {result['precision']}",
             f"published network: {result['parameters'] / 1e6:.2f} M parameters, variant {result['variant']}, "
             f"random weights",
             "ecir: events and image to frames; the others: histograms and keypoints, already made, to frames", ""]
    body = []
    for name, each in rows.items():
        ms, error = each["ms"], each["error"]
        body.append([name, f"{ms['median']:.0f}", f"{ms['low']:.0f}-{ms['high']:.0f}"]
                    + [f"{each['stages'][stage]:.0f}" if stage in each["stages"] else "" for stage in networks.STAGES]
                    + [f"{error:.1e}" if error is not None else "", f"{100 * each['others']:.0f} %"])
    lines.append(table(["ms a frame", "median", "range", "U-Net", "curve", "refine", "error", "others"], body))
    there = [name for name in references if name in rows]
    body = []
    for name, over in result["ratios"].items():
        cells = [f"{over[other]['median']:.2f} ({over[other]['low']:.2f}-{over[other]['high']:.2f})"
                 if other in over else "" for other in there]
        body.append([name, *cells])
    lines += ["", table(["time over that of", *there], body), ""]
    lines += [f"{name}: {each['versions']}" for name, each in rows.items()]
    lines += [f"left out: {name}: {why}" for name, why in result["left_out"].items()]
    return "\n".join(lines)
