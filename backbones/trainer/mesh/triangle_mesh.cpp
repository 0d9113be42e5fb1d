// SPDX-License-Identifier: Apache-2.0
#include "trainer/mesh/triangle_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <numeric>
#include <sstream>
#include <string>

#include <nlohmann/json.hpp>

#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

template <class T>
void put(std::ostream& out, const T& value) {
  out.write(reinterpret_cast<const char*>(&value), sizeof value);
}

void write_ply(std::ostream& out, const TriangleMesh& mesh) {
  const bool colored = !mesh.colors.empty(), translucent = !mesh.opacities.empty();
  out << "ply\nformat binary_little_endian 1.0\nelement vertex " << mesh.vertices()
      << "\nproperty float x\nproperty float y\nproperty float z\n";
  if (colored) out << "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  if (translucent) out << "property uchar alpha\n";
  out << "element face " << mesh.size() << "\nproperty list uchar int vertex_indices\nend_header\n";
  for (std::size_t i = 0; i < mesh.vertices(); ++i) {
    out.write(reinterpret_cast<const char*>(&mesh.positions[3 * i]), 3 * sizeof(float));
    if (colored) out.write(reinterpret_cast<const char*>(&mesh.colors[3 * i]), 3);
    if (translucent) put(out, mesh.opacities[i]);
  }
  for (std::size_t t = 0; t < mesh.size(); ++t) {
    put(out, std::uint8_t{3});
    out.write(reinterpret_cast<const char*>(&mesh.triangles[3 * t]), 3 * sizeof(std::uint32_t));
  }
}

/// Colours of a mesh are encoded as in images (sRGB), the vertex colours of glTF are linear. 16 bits keep dark ones
/// apart.
std::array<std::uint16_t, 256> linear_colors() {
  std::array<std::uint16_t, 256> linear;
  for (std::size_t k = 0; k < linear.size(); ++k) {
    const double c = static_cast<double>(k) / 255;
    const double value = c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
    linear[k] = static_cast<std::uint16_t>(std::lround(65535 * value));
  }
  return linear;
}

void write_glb(std::ostream& out, const TriangleMesh& mesh) {
  constexpr int kFloat = 5126, kShort = 5123, kUnsigned = 5125, kVertices = 34962, kIndices = 34963;
  const std::size_t n = mesh.vertices();
  std::array<float, 3> low, high;
  low.fill(n > 0 ? std::numeric_limits<float>::max() : 0);
  high.fill(n > 0 ? std::numeric_limits<float>::lowest() : 0);
  for (std::size_t k = 0; k < mesh.positions.size(); ++k) {
    low[k % 3] = std::min(low[k % 3], mesh.positions[k]);
    high[k % 3] = std::max(high[k % 3], mesh.positions[k]);
  }
  const std::size_t positions = 12 * n, colors = mesh.colors.empty() ? 0 : 8 * n, indices = 12 * mesh.size();
  const std::size_t bytes = positions + colors + indices;
  require(bytes < std::numeric_limits<std::uint32_t>::max() - (std::size_t{1} << 16),
          "the mesh is too large for a .glb file, which has 32-bit lengths; write a .ply file");
  nlohmann::json gltf = {
      {"asset", {{"version", "2.0"}, {"generator", "splatboost"}}},
      {"scene", 0},
      {"scenes", {{{"nodes", {0}}}}},
      {"nodes", {{{"mesh", 0}}}},
      {"buffers", {{{"byteLength", bytes}}}},
      {"bufferViews",
       {{{"buffer", 0}, {"byteOffset", 0}, {"byteLength", positions}, {"target", kVertices}},
        {{"buffer", 0}, {"byteOffset", positions + colors}, {"byteLength", indices}, {"target", kIndices}}}},
      {"accessors",
       {{{"bufferView", 0}, {"componentType", kFloat}, {"count", n}, {"type", "VEC3"}, {"min", low}, {"max", high}},
        {{"bufferView", 1}, {"componentType", kUnsigned}, {"count", 3 * mesh.size()}, {"type", "SCALAR"}}}},
      {"meshes", {{{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"indices", 1}}}}}}}};
  if (colors > 0) {
    gltf["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", positions}, {"byteLength", colors}, {"target", kVertices}});
    gltf["accessors"].push_back(
        {{"bufferView", 2}, {"componentType", kShort}, {"normalized", true}, {"count", n}, {"type", "VEC4"}});
    gltf["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 2;
    // Unlit, because the colours of photos contain the light. Without a material viewers assume metal.
    nlohmann::json material;
    material["pbrMetallicRoughness"]["metallicFactor"] = 0;
    material["extensions"]["KHR_materials_unlit"] = nlohmann::json::object();
    if (!mesh.opacities.empty()) {
      material["alphaMode"] = "BLEND";
      material["doubleSided"] = true;
    }
    gltf["extensionsUsed"].push_back("KHR_materials_unlit");
    gltf["materials"].push_back(material);
    gltf["meshes"][0]["primitives"][0]["material"] = 0;
  }
  std::string text = gltf.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  const auto length = [](std::size_t size) { return static_cast<std::uint32_t>(size); };
  out.write("glTF", 4);
  put(out, std::uint32_t{2});
  put(out, length(12 + 8 + text.size() + 8 + bytes));
  put(out, length(text.size()));
  out.write("JSON", 4);
  out.write(text.data(), static_cast<std::streamsize>(text.size()));
  put(out, length(bytes));
  out.write("BIN\0", 4);
  out.write(reinterpret_cast<const char*>(mesh.positions.data()), static_cast<std::streamsize>(positions));
  const std::array<std::uint16_t, 256> linear = linear_colors();
  for (std::size_t i = 0; i < colors / 8; ++i) {
    for (std::size_t c = 0; c < 3; ++c) put(out, linear[mesh.colors[3 * i + c]]);
    put(out, static_cast<std::uint16_t>(257 * (mesh.opacities.empty() ? 255 : mesh.opacities[i])));
  }
  out.write(reinterpret_cast<const char*>(mesh.triangles.data()), static_cast<std::streamsize>(indices));
}

/// A property that the header declares for an element.
struct PlyProperty {
  std::string name, type, count_type;  ///< count_type: of a list, else empty
};
struct PlyElement {
  std::string name;
  std::size_t count = 0;
  std::vector<PlyProperty> properties;
};

/// Reads the numbers of a .ply one at a time.
class PlyNumbers {
 public:
  PlyNumbers(std::istream& in, bool text, std::string file) : in_(in), text_(text), file_(std::move(file)) {}

  double next(const std::string& type) {
    if (text_) {
      double value = 0;
      require(static_cast<bool>(in_ >> value),
              file_ + ": the file ends early or contains a value that is not a number");
      return value;
    }
    if (type == "float" || type == "float32") return load<float>();
    if (type == "double" || type == "float64") return load<double>();
    if (type == "uchar" || type == "uint8") return load<std::uint8_t>();
    if (type == "char" || type == "int8") return load<std::int8_t>();
    if (type == "ushort" || type == "uint16") return load<std::uint16_t>();
    if (type == "short" || type == "int16") return load<std::int16_t>();
    if (type == "uint" || type == "uint32") return load<std::uint32_t>();
    if (type == "int" || type == "int32") return load<std::int32_t>();
    throw InputError(file_ + ": unknown property type '" + type + "'");
  }

 private:
  template <class T>
  double load() {
    T value{};
    in_.read(reinterpret_cast<char*>(&value), sizeof value);
    require(in_.gcount() == sizeof value, file_ + ": the file ends early");
    return static_cast<double>(value);
  }
  std::istream& in_;
  bool text_;
  std::string file_;
};

}  // namespace

std::size_t keep_largest_parts(TriangleMesh& mesh, std::size_t least_triangles, std::size_t most) {
  std::vector<std::uint32_t> parent(mesh.vertices());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](std::uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (std::size_t t = 0; t < mesh.size(); ++t) {
    const std::uint32_t a = root(mesh.triangles[3 * t]);
    for (std::size_t k = 1; k < 3; ++k) {
      const std::uint32_t b = root(mesh.triangles[3 * t + k]), first = root(a);
      parent[std::max(first, b)] = std::min(first, b);
    }
  }
  std::map<std::uint32_t, std::size_t> sizes;
  for (std::size_t t = 0; t < mesh.size(); ++t) ++sizes[root(mesh.triangles[3 * t])];
  std::vector<std::pair<std::size_t, std::uint32_t>> largest;
  for (const auto& [part, size] : sizes) {
    if (size >= least_triangles) largest.emplace_back(size, part);
  }
  std::sort(largest.begin(), largest.end(), [](const auto& a, const auto& b) {
    return a.first > b.first || (a.first == b.first && a.second < b.second);
  });
  if (most > 0 && largest.size() > most) largest.resize(most);
  std::vector<std::uint8_t> kept(mesh.vertices(), 0);
  for (const auto& part : largest) kept[part.second] = 1;

  TriangleMesh out;
  constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> number(mesh.vertices(), kNone);
  for (std::size_t t = 0; t < mesh.size(); ++t) {
    if (kept[root(mesh.triangles[3 * t])] == 0) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t v = mesh.triangles[3 * t + k];
      if (number[v] == kNone) {
        number[v] = static_cast<std::uint32_t>(out.vertices());
        out.positions.insert(out.positions.end(), &mesh.positions[3 * v], &mesh.positions[3 * v] + 3);
        if (!mesh.colors.empty()) out.colors.insert(out.colors.end(), &mesh.colors[3 * v], &mesh.colors[3 * v] + 3);
        if (!mesh.opacities.empty()) out.opacities.push_back(mesh.opacities[v]);
      }
      out.triangles.push_back(number[v]);
    }
  }
  mesh = std::move(out);
  return sizes.size();
}

void write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh) {
  const std::string ending = path.extension();
  require(ending == ".ply" || ending == ".glb", path.string() + ": a mesh can only be written to a .ply or .glb file");
  write_file_atomically(path,
                        [&](std::ostream& out) { ending == ".ply" ? write_ply(out, mesh) : write_glb(out, mesh); });
}

TriangleMesh read_mesh(const std::filesystem::path& path) {
  const std::string file = path.string();
  require(is_file(path), file + ": there is no such file");
  std::ifstream in(path, std::ios::binary);
  std::string line, word, format;
  require(std::getline(in, line) && line.substr(0, 3) == "ply", file + ": not a .ply file; only .ply meshes are read");
  std::vector<PlyElement> elements;
  while (std::getline(in, line)) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    std::istringstream words(line);
    words >> word;
    if (word == "end_header") break;
    if (word == "format") words >> format;
    if (word == "element") {
      PlyElement element;
      require(static_cast<bool>(words >> element.name >> element.count), file + ": damaged header");
      elements.push_back(element);
    }
    if (word == "property") {
      require(!elements.empty(), file + ": damaged header");
      PlyProperty property;
      words >> property.type;
      if (property.type == "list") words >> property.count_type >> property.type;
      require(static_cast<bool>(words >> property.name), file + ": damaged header");
      elements.back().properties.push_back(property);
    }
  }
  require(static_cast<bool>(in), file + ": the header has no end_header line");
  require(format == "ascii" || format == "binary_little_endian", file + ": format '" + format + "' is not supported");
  PlyNumbers numbers(in, format == "ascii", file);
  TriangleMesh mesh;
  std::uint64_t bytes = std::filesystem::file_size(path);
  for (const PlyElement& element : elements) {
    require(element.count <= bytes, file + ": the file is too small for the element counts in its header");
    const bool is_vertex = element.name == "vertex", is_face = element.name == "face";
    for (std::size_t i = 0; i < element.count; ++i) {
      std::array<float, 3> position{NAN, NAN, NAN};
      for (const PlyProperty& property : element.properties) {
        if (property.count_type.empty()) {
          const auto value = static_cast<float>(numbers.next(property.type));
          if (property.name == "x") position[0] = value;
          if (property.name == "y") position[1] = value;
          if (property.name == "z") position[2] = value;
          continue;
        }
        const double count = numbers.next(property.count_type);
        require(count >= 0 && count <= static_cast<double>(bytes), file + ": a list has an invalid length");
        const bool corners = is_face && property.name.rfind("vertex_ind", 0) == 0;
        std::uint32_t first = 0, last = 0;
        for (int k = 0; k < static_cast<int>(count); ++k) {
          const double value = numbers.next(property.type);
          if (!corners) continue;
          require(value >= 0 && value < static_cast<double>(mesh.vertices()),
                  file + ": a face refers to a vertex that does not exist");
          const auto corner = static_cast<std::uint32_t>(value);
          if (k == 0) first = corner;
          if (k >= 2) mesh.triangles.insert(mesh.triangles.end(), {first, last, corner});
          last = corner;
        }
      }
      if (!is_vertex) continue;
      for (const float value : position) require(std::isfinite(value), file + ": a vertex has no finite x, y or z");
      mesh.positions.insert(mesh.positions.end(), position.begin(), position.end());
    }
  }
  require(mesh.vertices() > 0, file + ": the mesh has no vertices");
  return mesh;
}

}  // namespace splatboost
