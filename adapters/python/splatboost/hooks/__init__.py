# SPDX-License-Identifier: Apache-2.0
"""What a patched host calls: one module a backbone. `splatboost patch show NAME` tells where the calls stand."""
