# SPDX-License-Identifier: Apache-2.0
"""What a patched host calls: one module per backbone. `splatboost patch show NAME` shows where the calls are."""
