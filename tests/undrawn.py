"""Reports without the work of drawing their pictures, and with few draws for their margins."""

from dataclasses import replace

__all__ = ["undraw"]


def undraw(patch):
    """Leave it out as long as this patch of pytest's holds."""
    from ambid.report import chapters, pictures  # not at the top: few tests need those rooms
    from ambid.robustness.procedure import FEWEST_DRAWS

    empty = pictures.Picture("data:image/gif;base64,R0lGODlhAQABAAAAACw=", "", 1.0)
    patch.setattr(pictures, "as_picture", lambda figure, caption: replace(empty, caption=caption))
    patch.setattr(chapters, "DRAWS", FEWEST_DRAWS)
