"""Keys of a cfg that matter in training only, by kind of section; they are passed over."""

NET = frozenset(
    {
        "angle", "aspect", "batch", "blur", "burn_in", "cutmix", "decay", "ema_alpha", "exposure",
        "flip", "gamma", "gaussian_noise", "hue", "learning_rate", "max_batches",
        "max_chart_loss", "max_crop", "min_crop", "mixup", "momentum", "mosaic", "policy",
        "power", "random", "resize_step", "saturation", "scale", "scales", "seed", "step",
        "steps", "subdivisions", "track",
    }
)  # fmt: skip
LAYER = frozenset(
    {
        "learning_rate", "stopbackward", "train_only_bn",
    }
)  # fmt: skip
HEAD = frozenset(
    {
        "absolute", "beta_nms", "bias_match", "class_scale", "cls_normalizer", "coord_scale",
        "counters_per_class", "delta_normalizer", "focal_loss", "ignore_thresh", "iou_loss",
        "iou_normalizer", "iou_thresh", "iou_thresh_kind", "jitter", "label_smooth_eps",
        "mask_scale", "max", "max_delta", "noobject_scale", "obj_normalizer", "object_scale",
        "objectness_smooth", "random", "rescore", "resize", "thresh", "truth_thresh",
    }
)  # fmt: skip
