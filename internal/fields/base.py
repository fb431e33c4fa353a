# SPDX-License-Identifier: Apache-2.0
"""The small interface behind which fields differ.

Heads (F1, F2, phi), compositing, losses and scripts are the same for all of them.
Gaussians come warped by the ``Space``: inside the cube [-1, 1]^3 where the scene is
well seen, at most 2 from the centre where it is contracted.
"""

from typing import Any, Protocol, runtime_checkable

from flax import linen as nn
from jax import Array
from jaxtyping import Float


@runtime_checkable
class Trunk(Protocol):
    """F_density (LLNeRF Eq. 1): Gaussians -> raw density and features tau."""

    def __call__(
        self, mean: Float[Array, "*b 3"], var: Float[Array, "*b 3"]
    ) -> tuple[Float[Array, "*b"], Float[Array, "*b f"]]: ...


@runtime_checkable
class Proposal(Protocol):
    """A cheap raw density that only says where to look closer."""

    def __call__(
        self, mean: Float[Array, "*b 3"], var: Float[Array, "*b 3"]
    ) -> Float[Array, "*b"]: ...


@runtime_checkable
class FieldConfig(Protocol):
    """Sizes of one kind of field, and the modules made of them."""

    def trunk(self, name: str) -> Trunk:
        """The field itself, a Flax module called ``name`` inside its parent."""
        ...

    def proposal(self) -> Proposal | None:
        """The density of the levels before the last; None: the field's own."""
        ...


class Dense(nn.Module):
    """A dense layer that sees all samples on one axis: on a CPU the gradient of its
    kernel is then one plain matrix product, a quarter faster."""

    width: int
    use_bias: bool = True

    @nn.compact
    def __call__(self, inputs: Float[Array, "*b f"]) -> Float[Array, "*b g"]:
        layer = nn.Dense(
            self.width, self.use_bias, kernel_init=nn.initializers.glorot_uniform()
        )
        outputs: Any = layer(inputs.reshape(-1, inputs.shape[-1]))
        return outputs.reshape(*inputs.shape[:-1], self.width)
