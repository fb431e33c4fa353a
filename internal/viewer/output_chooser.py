# SPDX-License-Identifier: Apache-2.0
"""The controls that say which outputs are seen, and where one borders on another."""

from collections.abc import Callable, Mapping

import viser

from internal.rendering.evidence import EVIDENCE, legend_html
from internal.viewer.border import Border, split_at
from internal.viewer.canvas import NOTHING, PHOTO, Split
from internal.viewer.handlers import Guard, on_change
from internal.viewer.stage import camera_of

PHOTO_EXPLANATION = "the dark photo taken nearest to here, exact at its place"


class OutputChooser:
    """Two outputs of one browser, and the border between them."""

    def __init__(
        self,
        client: viser.ClientHandle,
        outputs: Mapping[str, str],
        border: Border,
        chosen: Callable[[Split], None],
        guarded: Guard,
    ) -> None:
        """
        Args:
            outputs: what each is; the first is shown at first.
            chosen: told each new choice.
        """
        gui = client.gui
        self._texts = {**outputs, PHOTO: PHOTO_EXPLANATION}
        self._client, self._border, self._chosen = client, border, chosen
        self._left = gui.add_dropdown("Picture", [*outputs, PHOTO])
        self._right = gui.add_dropdown("Beside it", [NOTHING, *outputs, PHOTO])
        self._split = gui.add_slider(
            "Split", 0.0, 1.0, 0.005, Split().split, visible=False,
            hint="the border can be dragged in the picture, too",
        )  # fmt: skip
        self._explanation = gui.add_markdown(self._explain())
        self._legend = gui.add_html(legend_html(), visible=False)
        on_change(guarded(self._choose), self._left, self._right, self._split)
        border.handle.on_drag(guarded(self._drag))

    @property
    def choice(self) -> Split:
        """What is chosen now."""
        return Split(self._left.value, self._right.value, self._split.value)

    def compare_with_photo(self) -> None:
        """Shows the photo beside the picture, unless a photo is shown already."""
        if PHOTO not in (self._left.value, self._right.value):
            self._right.value = PHOTO

    async def _choose(self, _: object) -> None:
        self._explanation.content = self._explain()
        self._legend.visible = EVIDENCE in (self.choice.left, self.choice.right)
        is_split = self.choice.right != NOTHING
        self._split.visible = self._border.handle.visible = is_split
        self._border.place(camera_of(self._client.camera), self.choice.split)
        self._chosen(self.choice)

    async def _drag(self, event: viser.SceneNodeDragEvent[viser.BoxHandle]) -> None:
        self._split.value = split_at(event.end_screen_pos)

    def _explain(self) -> str:
        shown = [self.choice.left, self.choice.right]
        return "  \n".join(
            f"*{name}: {self._texts[name]}*" for name in shown if name in self._texts
        )
