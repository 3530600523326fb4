"""A policy as plain C: one header, arrays of fixed sizes, single precision, nothing but math.h.

Some targets need special code to read constants, such as an AVR from its flash memory. For them, define POLICY_CONST
(how an array is declared) and POLICY_READ(address) before including the header.
"""

from __future__ import annotations

import numpy as np

from mazeplan.control.policy import INPUTS, KNOWN, Policy, Single

HEAD = """\
/* A learned policy of mazeplan: from the state of the ball to the tilt of the plate. `mazeplan policy export` wrote it.
   Inputs, in this order (docs/policy.md):
{names}
   policy_tilt gives the tilt out from the centre and along the ring, rad, not limited; policy_distance how far inputs
   are from the training data: up to 1 they are known. */
#ifndef MAZEPLAN_POLICY_H
#define MAZEPLAN_POLICY_H

#include <math.h>

#ifndef POLICY_CONST
#define POLICY_CONST static const float
#endif
#ifndef POLICY_READ
#define POLICY_READ(address) (*(address))
#endif
#define POLICY_INPUTS {inputs}
#define POLICY_KNOWN {known}
#define POLICY_CENTRES {centres}
#define POLICY_LIMIT {limit}
#define POLICY_REACH {reach}
"""
LAYER = """\
static void policy_layer{k}(const float *in, float *out)
{{
    int i, j;
    for (i = 0; i < {rows}; i++) {{
        float sum = POLICY_READ(&policy_bias{k}[i]);
        for (j = 0; j < {columns}; j++)
            sum += POLICY_READ(&policy_weights{k}[i * {columns} + j]) * in[j];
        out[i] = {end};
    }}
}}
"""
DISTANCE = """\
static float policy_distance(const float *inputs)
{
    float least = INFINITY, z[POLICY_KNOWN];
    int i, j;
    for (j = 0; j < POLICY_KNOWN; j++)
        z[j] = (inputs[j] - POLICY_READ(&policy_mean[j])) / POLICY_READ(&policy_scale[j]);
    for (i = 0; i < POLICY_CENTRES; i++) {
        float sum = 0.0f;
        for (j = 0; j < POLICY_KNOWN; j++) {
            float gap = POLICY_READ(&policy_centres[i * POLICY_KNOWN + j]) - z[j];
            sum += gap * gap;
        }
        least = sum < least ? sum : least;
    }
    return sqrtf(least) / POLICY_REACH;
}

#endif
"""


def c_header(policy: Policy) -> str:
    """The text of the header."""
    names = [f"   {'  '.join(INPUTS[k : k + 6])}" for k in range(0, len(INPUTS), 6)]
    parts = [
        HEAD.format(
            names="\n".join(names), inputs=len(INPUTS), known=KNOWN, centres=len(policy.centres),
            limit=_number(policy.limit), reach=_number(policy.reach),
        ),
        _array("mean", policy.mean), _array("scale", policy.scale), _array("centres", policy.centres),
    ]  # fmt: skip
    last = len(policy.layers) - 1
    for k, (weights, bias) in enumerate(policy.layers):
        end = "POLICY_LIMIT * sum" if k == last else "tanhf(sum)"
        rows, columns = weights.shape
        parts += [_array(f"weights{k}", weights), _array(f"bias{k}", bias)]
        parts.append(LAYER.format(k=k, rows=rows, columns=columns, end=end))
    return "\n".join([*parts, _tilt(policy), DISTANCE])


def _tilt(policy: Policy) -> str:
    """The C function that evaluates all layers, alternating between two buffers."""
    widest = max(len(INPUTS), *(len(bias) for _, bias in policy.layers))
    buffers, last = ("a", "b"), len(policy.layers) - 1
    calls = [
        f"    policy_layer{k}({buffers[k % 2]}, {'tilt' if k == last else buffers[(k + 1) % 2]});"
        for k in range(last + 1)
    ]
    return "\n".join([
        "static void policy_tilt(const float *inputs, float *tilt)", "{",
        f"    float a[{widest}]{f', b[{widest}]' * (last > 0)};", "    int j;",
        "    for (j = 0; j < POLICY_INPUTS; j++)",
        "        a[j] = (inputs[j] - POLICY_READ(&policy_mean[j])) / POLICY_READ(&policy_scale[j]);",
        *calls, "}", "",
    ])  # fmt: skip


def _array(name: str, values: Single) -> str:
    flat = [_number(value) for value in values.ravel().tolist()]
    rows = [", ".join(flat[k : k + 6]) for k in range(0, len(flat), 6)]
    return f"POLICY_CONST policy_{name}[{len(flat)}] = {{\n    " + ",\n    ".join(rows) + "\n};\n"


def _number(value: float) -> str:
    """A float of C, to the last bit of single precision."""
    text = f"{np.float32(value):.9g}"
    return f"{text}f" if any(mark in text for mark in ".en") else f"{text}.0f"
