// SPDX-License-Identifier: Apache-2.0
#include "convex_splatting/convex_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>

#include "convex_splatting/convex_shapes.h"
#include "splatboost/constants.h"
#include "splatboost/convex_training.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr float kShDc = 0.28209479177387814f;  // degree-0 basis value

float sigmoid(float x) { return 1 / (1 + std::exp(-x)); }

std::uint8_t byte_of(float value) {
  return static_cast<std::uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f)));
}

/// Faces of the hull of six points: triples with all others on one side.
void append_hull(const std::array<glm::vec3, kConvexPoints>& points, std::uint32_t first,
                 std::vector<std::uint32_t>& triangles) {
  for (std::uint32_t a = 0; a < kConvexPoints; ++a) {
    for (std::uint32_t b = a + 1; b < kConvexPoints; ++b) {
      for (std::uint32_t c = b + 1; c < kConvexPoints; ++c) {
        const glm::dvec3 at(points[a]);
        const glm::dvec3 normal = glm::cross(glm::dvec3(points[b]) - at, glm::dvec3(points[c]) - at);
        double least = 0, most = 0;
        for (std::uint32_t p = 0; p < kConvexPoints; ++p) {
          if (p == a || p == b || p == c) continue;
          const double side = glm::dot(normal, glm::dvec3(points[p]) - at);
          least = std::min(least, side);
          most = std::max(most, side);
        }
        if (least < 0 && most > 0) continue;  // it cuts through
        if (most > 0) {
          triangles.insert(triangles.end(), {first + a, first + c, first + b});
        } else {
          triangles.insert(triangles.end(), {first + a, first + b, first + c});
        }
      }
    }
  }
}

template <class T>
void put(std::ostream& out, const T* values, std::size_t count) {
  out.write(reinterpret_cast<const char*>(values), static_cast<std::streamsize>(count * sizeof(T)));
}

void write_ply(std::ostream& out, const ConvexMesh& mesh) {
  const std::size_t vertices = mesh.positions.size() / 3;
  out << "ply\nformat binary_little_endian 1.0\nelement vertex " << vertices
      << "\nproperty float x\nproperty float y\nproperty float z\n"
         "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\nelement face "
      << mesh.triangles.size() / 3 << "\nproperty list uchar int vertex_indices\nend_header\n";
  for (std::size_t i = 0; i < vertices; ++i) {
    put(out, &mesh.positions[3 * i], 3);
    put(out, &mesh.colors[4 * i], 4);
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
    out.put(3);
    put(out, &mesh.triangles[t], 3);
  }
}

void write_glb(std::ostream& out, const ConvexMesh& mesh) {
  constexpr int kFloat = 5126, kByte = 5121, kUnsigned = 5125, kVertexBuffer = 34962, kIndexBuffer = 34963;
  const std::size_t vertices = mesh.positions.size() / 3;
  std::array<float, 3> low{}, high{};
  for (std::size_t k = 0; k < mesh.positions.size(); ++k) {
    low[k % 3] = k < 3 ? mesh.positions[k] : std::min(low[k % 3], mesh.positions[k]);
    high[k % 3] = k < 3 ? mesh.positions[k] : std::max(high[k % 3], mesh.positions[k]);
  }
  const std::size_t positions = 12 * vertices, colors = 4 * vertices, indices = 4 * mesh.triangles.size();
  const std::size_t bytes = positions + colors + indices;
  require(bytes < std::numeric_limits<std::uint32_t>::max() - (std::size_t{1} << 16),
          "the mesh is too large for a .glb, whose lengths have 32 bits; write a .ply");
  const nlohmann::json gltf = {
      {"asset", {{"version", "2.0"}, {"generator", "splatboost"}}},
      {"scene", 0},
      {"scenes", {{{"nodes", {0}}}}},
      {"nodes", {{{"mesh", 0}}}},
      {"materials", {{{"alphaMode", "BLEND"}, {"doubleSided", true}}}},
      {"meshes",
       {{{"primitives", {{{"attributes", {{"POSITION", 0}, {"COLOR_0", 1}}}, {"indices", 2}, {"material", 0}}}}}}},
      {"buffers", {{{"byteLength", bytes}}}},
      {"bufferViews",
       {{{"buffer", 0}, {"byteOffset", 0}, {"byteLength", positions}, {"target", kVertexBuffer}},
        {{"buffer", 0}, {"byteOffset", positions}, {"byteLength", colors}, {"target", kVertexBuffer}},
        {{"buffer", 0}, {"byteOffset", positions + colors}, {"byteLength", indices}, {"target", kIndexBuffer}}}},
      {"accessors",
       {{{"bufferView", 0},
         {"componentType", kFloat},
         {"count", vertices},
         {"type", "VEC3"},
         {"min", low},
         {"max", high}},
        {{"bufferView", 1}, {"componentType", kByte}, {"normalized", true}, {"count", vertices}, {"type", "VEC4"}},
        {{"bufferView", 2}, {"componentType", kUnsigned}, {"count", mesh.triangles.size()}, {"type", "SCALAR"}}}}};
  std::string text = gltf.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  const auto put_length = [&](std::size_t length) {
    const auto short_length = static_cast<std::uint32_t>(length);
    put(out, &short_length, 1);
  };
  out.write("glTF", 4);
  put_length(2);
  put_length(12 + 8 + text.size() + 8 + bytes);
  put_length(text.size());
  out.write("JSON", 4);
  out.write(text.data(), static_cast<std::streamsize>(text.size()));
  put_length(bytes);
  out.write("BIN\0", 4);
  put(out, mesh.positions.data(), mesh.positions.size());
  put(out, mesh.colors.data(), mesh.colors.size());
  put(out, mesh.triangles.data(), mesh.triangles.size());
}

}  // namespace

ConvexMesh convex_mesh(const ConvexCloud& cloud) {
  ConvexMesh mesh;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float opacity = sigmoid(cloud.logit_opacities[i]);
    if (sigmoid(cloud.logit_masks[i]) <= kConvexMaskThreshold || opacity <= kMinAlpha) continue;
    const auto first = static_cast<std::uint32_t>(mesh.positions.size() / 3);
    require(first < std::numeric_limits<std::uint32_t>::max() - kConvexPoints, "too many convexes for one mesh");
    std::array<glm::vec3, kConvexPoints> points;
    for (std::size_t p = 0; p < kConvexPoints; ++p) {
      for (int c = 0; c < 3; ++c) {
        points[p][c] = cloud.points[kConvexWidth * i + 3 * p + static_cast<std::size_t>(c)];
        mesh.positions.push_back(points[p][c]);
      }
      for (std::size_t c = 0; c < 3; ++c) mesh.colors.push_back(byte_of(0.5f + kShDc * cloud.sh_dc[3 * i + c]));
      mesh.colors.push_back(byte_of(opacity));
    }
    append_hull(points, first, mesh.triangles);
  }
  require(!mesh.triangles.empty(), "the model has no convex that is drawn");
  return mesh;
}

void write_convex_mesh(const std::filesystem::path& path, const ConvexMesh& mesh) {
  const std::string ending = path.extension().string();
  require(ending == ".ply" || ending == ".glb", path.string() + ": the name of a mesh ends in .ply or .glb");
  write_file_atomically(path,
                        [&](std::ostream& out) { ending == ".ply" ? write_ply(out, mesh) : write_glb(out, mesh); });
}

}  // namespace splatboost
