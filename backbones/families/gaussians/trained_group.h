// SPDX-License-Identifier: Apache-2.0
/// @file Has moved.
#pragma once

#include "trainer/backbone_api/trained_group.h"
