from schemas.messages import BOX_COLUMNS, OBJECT_CLASSES, Detection


class Tunnel:
    runtime = "python"

    def __init__(self, variant, setting):
        width_px = setting.size_px[0]
        self.left_px = width_px * (1 - variant.share) / 2
        self.right_px = width_px - self.left_px

    def detect(self, images, boxes):
        return [[self._seen(row) for row in rows.tolist() if self._within(row)] for rows in boxes]

    def _within(self, row):
        box = dict(zip(BOX_COLUMNS, row, strict=True))
        middle_px = box["x_px"] + box["width_px"] / 2
        return box["visible_px"] > 0 and self.left_px <= middle_px <= self.right_px

    def _seen(self, row):
        box = dict(zip(BOX_COLUMNS, row, strict=True))
        place = {name: box[name] for name in ("x_px", "y_px", "width_px", "height_px")}
        return Detection(label=OBJECT_CLASSES[int(box["class_id"])], confidence=1.0, **place)
