// SPDX-License-Identifier: Apache-2.0
/// @file Text, numbers and colours of a report's page. The page is written as XML that is also HTML5 (every element
/// closed, every attribute quoted), so that any XML parser can check it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "trainer/report/report.h"

namespace splatboost::report {

/// Escapes text for use between tags and in attributes.
std::string escape(const std::string& text);
/// The value with `digits` decimals.
std::string number(double value, int digits);
std::string base64(std::span<const std::uint8_t> bytes);
/// 2026-01-31T12:00:00Z as 2026-01-31 12:00:00 UTC; anything else unchanged.
std::string human_date(std::string date);

/// Grey for the baseline, blue for the new run: distinguishable with colour vision deficiencies, and in print.
std::string color_of(std::size_t run, std::size_t runs);
/// Maps colours to runs; empty for one run.
std::string legend(const std::vector<ReportRun>& runs);

/// At most `limit` indices of `count`, evenly spread, first and last among them.
std::vector<std::size_t> spread(std::size_t count, std::size_t limit);

}  // namespace splatboost::report
