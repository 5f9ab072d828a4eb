"""The texts of a picture, for its golden file."""


def texts_of(*panels):
    """Titles, labels of the axes and of what is drawn, a line each panel."""
    lines = []
    for panel in panels:
        handles = [*panel.lines, *panel.containers, *panel.collections, *panel.patches]
        labels = [str(own.get_label()) for own in handles]
        labels = dict.fromkeys(label for label in labels if label and not label.startswith("_"))
        titles = (panel.get_title(loc="left"), panel.get_title(loc="right"), panel.get_xlabel(), panel.get_ylabel())
        lines.append(" | ".join([*filter(None, titles), *labels]))
    return "\n".join(lines)
