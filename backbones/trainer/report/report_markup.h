// SPDX-License-Identifier: Apache-2.0
/// @file Words, numbers and colours of a report's page. The page is written as XML that is also HTML5 (every element
/// closed, every attribute quoted), so that any XML parser can check it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "trainer/report/report.h"

namespace splatboost::report {

/// Text as it may stand between tags and in attributes.
std::string escape(const std::string& text);
/// With that many digits behind the point.
std::string number(double value, int digits);
std::string base64(std::span<const std::uint8_t> bytes);
/// 2026-01-31T12:00:00Z as 2026-01-31 12:00:00 UTC; anything else as it is.
std::string human_date(std::string date);

/// Grey for what is known, blue for what is new: apart for every kind of colour vision, and in print.
std::string color_of(std::size_t run, std::size_t runs);
/// Which colour is which run; empty for one run.
std::string legend(const std::vector<ReportRun>& runs);

/// At most `limit` indices of `count`, evenly spread, first and last among them.
std::vector<std::size_t> spread(std::size_t count, std::size_t limit);

}  // namespace splatboost::report
