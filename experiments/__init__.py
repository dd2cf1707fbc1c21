"""Learn to simulate: train networks on labels plus renders, and optimise the streets for a target.

    import experiments

    fitted = experiments.fit("photos", "runs/fit", few=14)
    fitted.verdict, fitted.miou, fitted.model.predict(images)
    searched = experiments.search("camvid", "CamVid", "runs/camvid", holdout="0006R0")
    experiments.reward(searched.attributes, "camvid", "CamVid").miou

Names are imported on first use; ``__init__.pyi`` lists them.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
