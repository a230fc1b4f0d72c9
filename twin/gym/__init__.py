"""Learning environments of Gymnasium over the slots of an engine: `docs/gym.md`.

``import twin.gym`` registers the shipped ones, ``gymnasium.make("drivetwin/lane-loop-v0")``. The
package needs the extra ``gym``.
"""

from twin.gym.making import make, make_vec, register_shipped

__all__ = ["make", "make_vec", "register_shipped"]

register_shipped()
