// SPDX-License-Identifier: Apache-2.0
#include "trainer/dataset/splat_ply.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <functional>
#include <optional>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

#include "splatboost/errors.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

static_assert(std::endian::native == std::endian::little, "the binary files here are little endian");

constexpr std::size_t kRowsPerBlock = 4096;

enum class PlyType { int8, uint8, int16, uint16, int32, uint32, float32, float64 };

std::size_t size_of(PlyType type) {
  switch (type) {
    case PlyType::int8:
    case PlyType::uint8:
      return 1;
    case PlyType::int16:
    case PlyType::uint16:
      return 2;
    case PlyType::int32:
    case PlyType::uint32:
    case PlyType::float32:
      return 4;
    case PlyType::float64:
      return 8;
  }
  return 0;
}

template <class T>
double load_as_double(const char* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return static_cast<double>(value);
}

double load(PlyType type, const char* bytes) {
  switch (type) {
    case PlyType::int8:
      return load_as_double<std::int8_t>(bytes);
    case PlyType::uint8:
      return load_as_double<std::uint8_t>(bytes);
    case PlyType::int16:
      return load_as_double<std::int16_t>(bytes);
    case PlyType::uint16:
      return load_as_double<std::uint16_t>(bytes);
    case PlyType::int32:
      return load_as_double<std::int32_t>(bytes);
    case PlyType::uint32:
      return load_as_double<std::uint32_t>(bytes);
    case PlyType::float32:
      return load_as_double<float>(bytes);
    case PlyType::float64:
      return load_as_double<double>(bytes);
  }
  return 0;
}

struct Property {
  std::string name;
  PlyType type = PlyType::float32;
  std::size_t offset = 0;
};

/// The vertices of a .ply as rows of numbers. Converting a float to double and back is exact.
class PlyVertices {
 public:
  explicit PlyVertices(const std::filesystem::path& path) : path_(path) {
    std::error_code error;
    if (!std::filesystem::exists(path, error)) fail("the file does not exist");
    if (!std::filesystem::is_regular_file(path, error)) fail("is not a file");
    file_size_ = std::filesystem::file_size(path, error);
    in_.open(path, std::ios::binary);
    if (error || !in_) fail("cannot be opened");
    read_header();
  }

  std::size_t rows() const { return rows_; }
  const std::vector<Property>& properties() const { return properties_; }

  /// Column of a property, or -1.
  int find(std::string_view name) const {
    for (std::size_t i = 0; i < properties_.size(); ++i) {
      if (properties_[i].name == name) return static_cast<int>(i);
    }
    return -1;
  }

  int require(const std::string& name) const {
    const int column = find(name);
    if (column < 0) fail("has no vertex property '" + name + "'");
    return column;
  }

  using RowVisitor = std::function<void(std::size_t row, std::span<const double> values)>;

  void read_rows(const RowVisitor& visit) { ascii_ ? read_ascii(visit) : read_binary(visit); }

  [[noreturn]] void fail(const std::string& cause) const { throw InputError(path_.string() + ": " + cause); }

 private:
  [[noreturn]] void fail_truncated(std::size_t row) const {
    fail("is cut short: the header promises " + std::to_string(rows_) + " vertices, the data end at vertex " +
         std::to_string(row));
  }

  /// A damaged count would silently drop vertices.
  [[noreturn]] void fail_more() const {
    fail("holds more data than the " + std::to_string(rows_) + " vertices that its header promises: it is damaged");
  }

  std::optional<PlyType> type_named(std::string_view name) const {
    static constexpr std::array<std::pair<std::string_view, PlyType>, 16> kNames{{{"char", PlyType::int8},
                                                                                  {"int8", PlyType::int8},
                                                                                  {"uchar", PlyType::uint8},
                                                                                  {"uint8", PlyType::uint8},
                                                                                  {"short", PlyType::int16},
                                                                                  {"int16", PlyType::int16},
                                                                                  {"ushort", PlyType::uint16},
                                                                                  {"uint16", PlyType::uint16},
                                                                                  {"int", PlyType::int32},
                                                                                  {"int32", PlyType::int32},
                                                                                  {"uint", PlyType::uint32},
                                                                                  {"uint32", PlyType::uint32},
                                                                                  {"float", PlyType::float32},
                                                                                  {"float32", PlyType::float32},
                                                                                  {"double", PlyType::float64},
                                                                                  {"float64", PlyType::float64}}};
    for (const auto& [known, type] : kNames) {
      if (known == name) return type;
    }
    return std::nullopt;
  }

  void read_header() {
    std::string line;
    const auto next_line = [&]() -> std::istringstream {
      // A header line is short; a longer one means that this is no .ply at all.
      line.clear();
      for (int c = in_.get(); c != '\n'; c = in_.get()) {
        if (c == std::char_traits<char>::eof()) fail("is cut short: the .ply header does not end");
        if (line.size() > 4096) fail("is not a .ply file");
        line.push_back(static_cast<char>(c));
      }
      if (!line.empty() && line.back() == '\r') line.pop_back();
      return std::istringstream(line);
    };

    std::array<char, 3> magic{};
    in_.read(magic.data(), 3);
    if (in_.gcount() != 3 || std::string_view(magic.data(), 3) != "ply") fail("is not a .ply file");
    next_line();

    bool in_vertex = false, after_vertex = false, has_format = false;
    bool skipped_list = false;
    std::size_t skipped_stride = 0;  // bytes per row of the current element, if it is not the vertices
    std::size_t skipped_count = 0;
    const auto close_element = [&] {
      if (in_vertex) after_vertex = true;
      if (!after_vertex && skipped_count > 0) {
        if (skipped_list) fail("has a list element before its vertices, which is not supported");
        const std::size_t row_bytes = ascii_ ? 1 : skipped_stride;  // in an ascii file at least the newline
        if (row_bytes > 0 && skipped_count > file_size_ / row_bytes) fail("is cut short");
        bytes_before_ += skipped_count * skipped_stride;
        lines_before_ += skipped_count;
      }
      in_vertex = false;
      skipped_list = false;
      skipped_stride = skipped_count = 0;
    };
    for (;;) {
      std::istringstream words = next_line();
      std::string keyword;
      words >> keyword;
      if (keyword == "end_header") break;
      if (keyword == "format") {
        std::string format;
        words >> format;
        has_format = true;
        if (format == "ascii") {
          ascii_ = true;
        } else if (format != "binary_little_endian") {
          fail("has the format '" + format + "'; supported are ascii and binary_little_endian");
        }
      } else if (keyword == "element") {
        close_element();
        std::string name;
        std::uint64_t count = 0;
        if (!(words >> name >> count)) fail("has a broken header line '" + line + "'");
        if (name == "vertex" && !after_vertex) {
          in_vertex = true;
          rows_ = count;
        } else {
          skipped_count = count;
          vertices_are_last_ = !after_vertex;
        }
      } else if (keyword == "property") {
        std::string type_name, name;
        words >> type_name;
        if (type_name == "list") {
          if (in_vertex) fail("has a list among its vertex properties, which is not supported");
          skipped_list = true;
          continue;
        }
        const std::optional<PlyType> type = type_named(type_name);
        if (!type || !(words >> name)) fail("has a broken header line '" + line + "'");
        if (in_vertex) {
          if (find(name) >= 0) fail("declares the vertex property '" + name + "' twice");
          properties_.push_back({name, *type, stride_});
          stride_ += size_of(*type);
        } else {
          skipped_stride += size_of(*type);
        }
      } else if (keyword != "comment" && keyword != "obj_info" && !keyword.empty()) {
        fail("has a broken header line '" + line + "'");
      }
    }
    close_element();
    if (!has_format) fail("has no 'format' line in its header");
    if (!after_vertex) fail("has no element 'vertex'");
    if (properties_.empty()) fail("has vertices without properties");

    // Checked before anything is allocated: is the file large enough? An ascii value and its separator take two bytes.
    const std::uint64_t begin = static_cast<std::uint64_t>(in_.tellg()) + (ascii_ ? 0 : bytes_before_);
    const std::uint64_t available = begin > file_size_ ? 0 : file_size_ - begin;
    const std::uint64_t row_bytes = ascii_ ? 2 * properties_.size() : stride_;
    const std::uint64_t slack = ascii_ ? 1 : 0;  // the last line may lack its newline
    if (rows_ > (available + slack) / row_bytes) fail_truncated((available + slack) / row_bytes);
    if (!ascii_ && vertices_are_last_ && available - rows_ * stride_ >= stride_) fail_more();
    if (!ascii_) in_.seekg(static_cast<std::streamoff>(begin));
  }

  void read_binary(const RowVisitor& visit) {
    std::vector<char> block(stride_ * std::min(rows_, kRowsPerBlock));
    std::vector<double> values(properties_.size());
    for (std::size_t first = 0; first < rows_; first += kRowsPerBlock) {
      const std::size_t count = std::min(kRowsPerBlock, rows_ - first);
      in_.read(block.data(), static_cast<std::streamsize>(count * stride_));
      if (static_cast<std::size_t>(in_.gcount()) != count * stride_) {
        fail_truncated(first + static_cast<std::size_t>(in_.gcount()) / stride_);
      }
      for (std::size_t row = 0; row < count; ++row) {
        const char* const bytes = block.data() + row * stride_;
        for (std::size_t i = 0; i < values.size(); ++i)
          values[i] = load(properties_[i].type, bytes + properties_[i].offset);
        visit(first + row, values);
      }
    }
  }

  void read_ascii(const RowVisitor& visit) {
    std::string word;
    std::vector<double> values(properties_.size());
    for (std::size_t i = 0; i < lines_before_; ++i) std::getline(in_, word);
    for (std::size_t row = 0; row < rows_; ++row) {
      for (double& value : values) {
        if (!(in_ >> word)) fail_truncated(row);
        const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
        if (error != std::errc() || end != word.data() + word.size()) {
          fail("vertex " + std::to_string(row) + " holds '" + word.substr(0, 40) + "', which is not a number");
        }
      }
      visit(row, values);
    }
    if (vertices_are_last_ && in_ >> word) fail_more();
  }

  std::filesystem::path path_;
  std::ifstream in_;
  std::uint64_t file_size_ = 0;
  bool ascii_ = false;
  std::size_t rows_ = 0;
  std::size_t stride_ = 0;
  std::uint64_t bytes_before_ = 0;  // data of elements that come before the vertices
  std::uint64_t lines_before_ = 0;
  bool vertices_are_last_ = true;  // no element follows
  std::vector<Property> properties_;
};

/// Columns of named properties. Looks the names up once, and checks that the values read are finite.
class Columns {
 public:
  Columns(const PlyVertices& ply, const std::vector<std::string>& names) : ply_(ply) {
    for (const std::string& name : names) columns_.push_back(ply.require(name));
  }

  void append(std::size_t row, std::span<const double> values, std::vector<float>& out) const {
    for (const int column : columns_) {
      const float value = static_cast<float>(values[static_cast<std::size_t>(column)]);
      if (!std::isfinite(value)) {
        ply_.fail("vertex " + std::to_string(row) + " has a '" +
                  ply_.properties()[static_cast<std::size_t>(column)].name + "' that is not a finite number");
      }
      out.push_back(value);
    }
  }

  std::size_t size() const { return columns_.size(); }

 private:
  const PlyVertices& ply_;
  std::vector<int> columns_;
};

std::vector<std::string> numbered(const std::string& prefix, int count) {
  std::vector<std::string> names;
  for (int i = 0; i < count; ++i) names.push_back(prefix + std::to_string(i));
  return names;
}

void write_header(std::ostream& out, std::size_t rows, const std::vector<std::string>& floats,
                  const std::vector<std::string>& bytes = {}) {
  out << "ply\nformat binary_little_endian 1.0\nelement vertex " << rows << "\n";
  for (const std::string& name : floats) out << "property float " << name << "\n";
  for (const std::string& name : bytes) out << "property uchar " << name << "\n";
  out << "end_header\n";
}

/// Throws if a value is not finite: every reader, including ours, would reject the file.
void require_finite(const std::filesystem::path& path, const std::vector<float>& values, std::size_t rows) {
  const auto wrong = std::ranges::find_if(values, [](float value) { return !std::isfinite(value); });
  if (wrong == values.end()) return;
  const std::size_t row = static_cast<std::size_t>(wrong - values.begin()) / (values.size() / rows);
  throw std::runtime_error(path.string() + ": not written: row " + std::to_string(row) +
                           " holds a number that is not finite; lower the learning rates in --config, or report this");
}

}  // namespace

void write_splat_ply(const std::filesystem::path& path, const SplatCloud& cloud) {
  const std::size_t n = cloud.size();
  const auto rest_rows = static_cast<std::size_t>(cloud.sh_rest_rows);
  SPLATBOOST_CHECK(
      cloud.sh_rest_rows == 0 || cloud.sh_rest_rows == 3 || cloud.sh_rest_rows == 8 || cloud.sh_rest_rows == 15,
      "spherical harmonics above degree 0 have 0, 3, 8 or 15 rows");
  SPLATBOOST_CHECK(cloud.means.size() == 3 * n && cloud.sh_dc.size() == 3 * n && cloud.log_scales.size() == 3 * n &&
                       cloud.rotations.size() == 4 * n && cloud.sh_rest.size() == 3 * n * rest_rows &&
                       (cloud.filters.empty() || cloud.filters.size() == n),
                   "all arrays of a splat cloud must have one row per splat");
  for (const std::vector<float>* values : {&cloud.means, &cloud.sh_dc, &cloud.sh_rest, &cloud.logit_opacities,
                                           &cloud.log_scales, &cloud.rotations, &cloud.filters}) {
    require_finite(path, *values, n);
  }

  write_file_atomically(path, [&](std::ostream& out) {
    std::vector<std::string> names{"x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"};
    const auto add = [&](const std::string& prefix, int count) {
      for (std::string& name : numbered(prefix, count)) names.push_back(std::move(name));
    };
    add("f_rest_", 3 * cloud.sh_rest_rows);
    names.emplace_back("opacity");
    add("scale_", 3);
    add("rot_", 4);
    if (!cloud.filters.empty()) names.emplace_back("filter_3D");
    write_header(out, n, names);

    std::vector<float> block;
    for (std::size_t first = 0; first < n && out; first += kRowsPerBlock) {
      block.clear();
      for (std::size_t i = first; i < std::min(n, first + kRowsPerBlock); ++i) {
        const auto append = [&](const std::vector<float>& values, std::size_t width) {
          block.insert(block.end(), values.begin() + static_cast<std::ptrdiff_t>(i * width),
                       values.begin() + static_cast<std::ptrdiff_t>((i + 1) * width));
        };
        append(cloud.means, 3);
        block.insert(block.end(), 3, 0.0f);  // normals: part of the layout, but unused
        append(cloud.sh_dc, 3);
        for (std::size_t channel = 0; channel < 3; ++channel) {
          for (std::size_t k = 0; k < rest_rows; ++k) block.push_back(cloud.sh_rest[(i * rest_rows + k) * 3 + channel]);
        }
        block.push_back(cloud.logit_opacities[i]);
        append(cloud.log_scales, 3);
        append(cloud.rotations, 4);
        if (!cloud.filters.empty()) append(cloud.filters, 1);
      }
      out.write(reinterpret_cast<const char*>(block.data()),
                static_cast<std::streamsize>(block.size() * sizeof(float)));
    }
  });
}

SplatCloud read_splat_ply(const std::filesystem::path& path) {
  PlyVertices ply(path);
  int rest = 0;
  for (const Property& property : ply.properties()) rest += property.name.starts_with("f_rest_") ? 1 : 0;
  if (rest != 0 && rest != 9 && rest != 24 && rest != 45) {
    ply.fail("has " + std::to_string(rest) + " properties f_rest_*; a 3DGS .ply has 0, 9, 24 or 45 (degree 0 to 3)");
  }

  const Columns means(ply, {"x", "y", "z"});
  const Columns sh_dc(ply, numbered("f_dc_", 3));
  const Columns sh_rest(ply, numbered("f_rest_", rest));
  const Columns opacity(ply, {"opacity"});
  const Columns scales(ply, numbered("scale_", 3));
  const Columns rotations(ply, numbered("rot_", 4));
  const Columns filters(
      ply, ply.find("filter_3D") >= 0 ? std::vector<std::string>{"filter_3D"} : std::vector<std::string>{});

  SplatCloud cloud;
  cloud.sh_rest_rows = rest / 3;
  const std::size_t n = ply.rows();
  const std::size_t rest_rows = sh_rest.size() / 3;
  cloud.means.reserve(3 * n);
  cloud.sh_dc.reserve(3 * n);
  cloud.sh_rest.resize(3 * n * rest_rows);
  cloud.logit_opacities.reserve(n);
  cloud.log_scales.reserve(3 * n);
  cloud.rotations.reserve(4 * n);
  std::vector<float> channel_major;
  ply.read_rows([&](std::size_t row, std::span<const double> values) {
    means.append(row, values, cloud.means);
    sh_dc.append(row, values, cloud.sh_dc);
    channel_major.clear();
    sh_rest.append(row, values, channel_major);
    for (std::size_t channel = 0; channel < 3; ++channel) {
      for (std::size_t k = 0; k < rest_rows; ++k) {
        cloud.sh_rest[(row * rest_rows + k) * 3 + channel] = channel_major[channel * rest_rows + k];
      }
    }
    opacity.append(row, values, cloud.logit_opacities);
    scales.append(row, values, cloud.log_scales);
    rotations.append(row, values, cloud.rotations);
    filters.append(row, values, cloud.filters);
  });
  return cloud;
}

namespace {

/// What a value of colour is multiplied by, so that the largest becomes 255: whole numbers are parts of the largest of
/// their type, floating-point ones are 0..1, or 0..255 if any is above 1.
double colour_scale(PlyType type, std::span<const double> colours) {
  if (type == PlyType::uint16) return 1.0 / 257;
  if (type != PlyType::float32 && type != PlyType::float64) return 1;
  return std::ranges::any_of(colours, [](double value) { return value > 1; }) ? 1 : 255;
}

}  // namespace

PointCloud read_point_ply(const std::filesystem::path& path) {
  PlyVertices ply(path);
  const Columns positions(ply, {"x", "y", "z"});
  const std::array<int, 3> color{ply.find("red"), ply.find("green"), ply.find("blue")};
  const bool has_color = std::ranges::all_of(color, [](int column) { return column >= 0; });
  PointCloud cloud;
  cloud.positions.reserve(3 * ply.rows());
  std::vector<double> colours;
  ply.read_rows([&](std::size_t row, std::span<const double> values) {
    positions.append(row, values, cloud.positions);
    for (int c = 0; has_color && c < 3; ++c) colours.push_back(values[static_cast<std::size_t>(color[c])]);
  });
  if (!has_color) {
    cloud.colors.assign(cloud.positions.size(), 128);
    return cloud;
  }
  const double scale = colour_scale(ply.properties()[static_cast<std::size_t>(color[0])].type, colours);
  cloud.colors.reserve(colours.size());
  for (const double value : colours) {
    cloud.colors.push_back(value >= 0 ? static_cast<std::uint8_t>(std::lround(std::min(value * scale, 255.0)))
                                      : std::uint8_t{0});
  }
  return cloud;
}

void require_no_model(const std::filesystem::path& output) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(output, error)) return;
  bool model = false;
  try {
    const PlyVertices ply(output);
    model = ply.find("f_dc_0") >= 0 || ply.find("f_offset_0") >= 0;
  } catch (const InputError&) {  // not a .ply
  }
  if (model) throw InputError(output.string() + ": holds a model, which would be replaced; name another file");
}

void write_point_ply(const std::filesystem::path& path, const PointCloud& cloud) {
  SPLATBOOST_CHECK(cloud.colors.size() == cloud.positions.size(), "each point needs a colour");
  require_finite(path, cloud.positions, cloud.size());
  write_file_atomically(path, [&](std::ostream& out) {
    write_header(out, cloud.size(), {"x", "y", "z", "nx", "ny", "nz"}, {"red", "green", "blue"});
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      std::array<float, 6> numbers{};
      std::copy_n(cloud.positions.begin() + static_cast<std::ptrdiff_t>(3 * i), 3, numbers.begin());
      out.write(reinterpret_cast<const char*>(numbers.data()), sizeof numbers);
      out.write(reinterpret_cast<const char*>(cloud.colors.data() + 3 * i), 3);
    }
  });
}

void write_float_ply(const std::filesystem::path& path, const FloatTable& table) {
  SPLATBOOST_CHECK(table.values.size() == table.rows() * table.names.size(),
                   "the number of values of a table must be its number of rows times its number of columns");
  require_finite(path, table.values, table.rows());
  write_file_atomically(path, [&](std::ostream& out) {
    write_header(out, table.rows(), table.names);
    out.write(reinterpret_cast<const char*>(table.values.data()),
              static_cast<std::streamsize>(table.values.size() * sizeof(float)));
  });
}

FloatTable read_float_ply(const std::filesystem::path& path, std::vector<std::string> names) {
  PlyVertices ply(path);
  const Columns columns(ply, names);
  FloatTable table{std::move(names), {}};
  table.values.reserve(ply.rows() * columns.size());
  ply.read_rows([&](std::size_t row, std::span<const double> values) { columns.append(row, values, table.values); });
  return table;
}

}  // namespace splatboost
