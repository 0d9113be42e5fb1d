// SPDX-License-Identifier: Apache-2.0
/// @file The functions of Photo-SLAM's CUDA files that train_colmap calls, on the CPU through SplatBoost's C ABI: its
/// rasterizer as published, with the 3σ square, and k-NN.
#include <cstring>
#include <map>
#include <memory>
#include <stdexcept>

#include "include/operate_points.h"
#include "include/rasterize_points.h"
#include "include/stereo_vision.h"
#include "splatboost/c_api.h"
#include "third_party/simple-knn/spatial.h"

namespace {

void require(sb_status status) {
  if (status != SB_OK) throw std::runtime_error(sb_last_error());
}

sb_tensor view(const torch::Tensor& tensor) {
  TORCH_CHECK(tensor.is_contiguous(), "dense tensors only");
  sb_tensor seen{};
  seen.data = tensor.data_ptr();
  seen.type = tensor.scalar_type() == torch::kInt ? SB_INT32 : SB_FLOAT32;
  seen.dimensions = static_cast<std::int32_t>(tensor.dim());
  for (int i = 0; i < seen.dimensions; ++i) {
    seen.shape[i] = tensor.size(i);
    seen.strides[i] = tensor.stride(i);
  }
  return seen;
}

sb_camera camera_of(const torch::Tensor& view_transform, float tan_x, float tan_y, int height, int width) {
  sb_camera camera{width, height, 0.5f * width / tan_x, 0.5f * height / tan_y, 0.5f * width, 0.5f * height, {}};
  const torch::Tensor rows = view_transform.t().contiguous();
  std::memcpy(camera.camera_from_world, rows.data_ptr<float>(), sizeof camera.camera_from_world);
  return camera;
}

/// The tensors of one call, and the C structs that refer to them.
struct Scene {
  torch::Tensor means, scales, rotations, opacities, dc, rest;
  sb_tensor means_view, scales_view, rotations_view, opacities_view, dc_view, rest_view;
  sb_gaussians gaussians{};

  Scene(const torch::Tensor& means_, const torch::Tensor& scales_, const torch::Tensor& rotations_,
        const torch::Tensor& opacities_, const torch::Tensor& sh, int degree)
      : means(means_.contiguous()),
        scales(scales_.contiguous()),
        rotations(rotations_.contiguous()),
        opacities(opacities_.contiguous()),
        dc(sh.slice(1, 0, 1).contiguous()),
        rest(sh.slice(1, 1).contiguous()),
        means_view(view(means)),
        scales_view(view(scales)),
        rotations_view(view(rotations)),
        opacities_view(view(opacities)),
        dc_view(view(dc)),
        rest_view(view(rest)) {
    gaussians.means = &means_view;
    gaussians.scales = &scales_view;
    gaussians.rotations = &rotations_view;
    gaussians.opacities = &opacities_view;
    gaussians.sh_dc = &dc_view;
    gaussians.sh_rest = &rest_view;
    gaussians.sh_degree = degree;
  }
};

/// The rasterizer, which holds the view drawn last.
sb_rasterizer* rasterizer() {
  static std::unique_ptr<sb_rasterizer, decltype(&sb_rasterizer_destroy)> one{nullptr, sb_rasterizer_destroy};
  if (!one) {
    sb_rasterizer* made = nullptr;
    require(sb_rasterizer_create(nullptr, &made));
    one.reset(made);
  }
  return one.get();
}

torch::Tensor draw(const torch::Tensor& background, const Scene& scene, const sb_camera& camera, torch::Tensor& radii) {
  sb_raster_options options;
  require(sb_raster_options_default(&options));
  for (int c = 0; c < 3; ++c) options.background[c] = background[c].item<float>();
  torch::Tensor color = torch::empty({3, camera.height, camera.width});
  radii = torch::empty({scene.means.size(0)}, torch::kInt);
  const sb_tensor color_view = view(color), radii_view = view(radii);
  sb_raster_outputs outputs{};
  outputs.color = &color_view;
  outputs.radii = &radii_view;
  require(sb_rasterizer_forward(rasterizer(), &camera, &scene.gaussians, &options, &outputs, nullptr));
  return color;
}

}  // namespace

std::tuple<int, torch::Tensor, torch::Tensor, torch::Tensor, torch::Tensor, torch::Tensor> RasterizeGaussiansCUDA(
    const torch::Tensor& background, const torch::Tensor& means3D, const torch::Tensor&, const torch::Tensor& opacity,
    const torch::Tensor& scales, const torch::Tensor& rotations, const float, const torch::Tensor&,
    const torch::Tensor& viewmatrix, const torch::Tensor&, const float tan_fovx, const float tan_fovy,
    const int image_height, const int image_width, const torch::Tensor& sh, const int degree, const torch::Tensor&,
    const bool) {
  const Scene scene(means3D, scales, rotations, opacity, sh, degree);
  torch::Tensor radii;
  torch::Tensor color =
      draw(background, scene, camera_of(viewmatrix, tan_fovx, tan_fovy, image_height, image_width), radii);
  // The backward pass draws the view again, hence the opacities.
  return {0, color, radii, opacity.detach().clone(), torch::empty(0), torch::empty(0)};
}

std::tuple<torch::Tensor, torch::Tensor, torch::Tensor, torch::Tensor, torch::Tensor, torch::Tensor, torch::Tensor,
           torch::Tensor>
RasterizeGaussiansBackwardCUDA(const torch::Tensor& background, const torch::Tensor& means3D, const torch::Tensor&,
                               const torch::Tensor&, const torch::Tensor& scales, const torch::Tensor& rotations,
                               const float, const torch::Tensor&, const torch::Tensor& viewmatrix, const torch::Tensor&,
                               const float tan_fovx, const float tan_fovy, const torch::Tensor& dL_dout_color,
                               const torch::Tensor& sh, const int degree, const torch::Tensor&,
                               const torch::Tensor& geomBuffer, const int, const torch::Tensor&, const torch::Tensor&) {
  const Scene scene(means3D, scales, rotations, geomBuffer, sh, degree);
  const int height = static_cast<int>(dL_dout_color.size(1)), width = static_cast<int>(dL_dout_color.size(2));
  torch::Tensor radii;
  draw(background, scene, camera_of(viewmatrix, tan_fovx, tan_fovy, height, width), radii);

  const torch::Tensor color = dL_dout_color.contiguous();
  const sb_tensor color_view = view(color);
  sb_image_gradients image_gradients{};
  image_gradients.color = &color_view;
  torch::Tensor means = torch::empty_like(scene.means), opacities = torch::empty_like(scene.opacities);
  torch::Tensor scales_out = torch::empty_like(scene.scales), rotations_out = torch::empty_like(scene.rotations);
  torch::Tensor dc = torch::empty_like(scene.dc), rest = torch::empty_like(scene.rest);
  torch::Tensor screen = torch::empty({means.size(0), 2});
  const sb_tensor means_view = view(means), opacities_view = view(opacities), scales_view = view(scales_out);
  const sb_tensor rotations_view = view(rotations_out), dc_view = view(dc), rest_view = view(rest);
  const sb_tensor screen_view = view(screen);
  sb_gaussian_gradients gradients{};
  gradients.means = &means_view;
  gradients.opacities = &opacities_view;
  gradients.scales = &scales_view;
  gradients.rotations = &rotations_view;
  gradients.sh_dc = &dc_view;
  gradients.sh_rest = &rest_view;
  gradients.screen_means = &screen_view;
  require(sb_rasterizer_backward(rasterizer(), &scene.gaussians, &image_gradients, &gradients, nullptr));

  // From pixels to 3DGS's NDC units.
  const torch::Tensor half = torch::tensor({0.5f * static_cast<float>(width), 0.5f * static_cast<float>(height)});
  const torch::Tensor screen_ndc = torch::cat({screen * half, torch::zeros({means.size(0), 1})}, 1);
  const torch::Tensor none = torch::zeros({0});
  return {screen_ndc, none, opacities, means, none, torch::cat({dc, rest}, 1), scales_out, rotations_out};
}

torch::Tensor distCUDA2(const torch::Tensor& points) {
  const torch::Tensor dense = points.contiguous();
  torch::Tensor distances = torch::empty({dense.size(0)});
  const sb_tensor points_view = view(dense), distances_view = view(distances);
  require(sb_mean_squared_neighbor_distances(nullptr, &points_view, 3, &distances_view));
  return distances;
}

namespace {
[[noreturn]] void not_here() { throw std::logic_error("only train_colmap runs on the CPU"); }
}  // namespace

torch::Tensor markVisible(torch::Tensor&, torch::Tensor&, torch::Tensor&) { not_here(); }
void transformPoints(torch::Tensor&, torch::Tensor&) { not_here(); }
void scaleAndTransformThenMarkVisiblePoints(torch::Tensor&, torch::Tensor&, torch::Tensor&, torch::Tensor&,
                                            torch::Tensor&, torch::Tensor&, torch::Tensor&, int&, const float) {
  not_here();
}
torch::Tensor reprojectDepthPinhole(torch::Tensor&, torch::Tensor&, std::vector<float>&, int) { not_here(); }
std::tuple<torch::Tensor, torch::Tensor> monocularPinholeInactiveGeoDensifyBySearchingNeighborhoodKeypoints(
    torch::Tensor&, torch::Tensor&, torch::Tensor&, torch::Tensor&, float, std::vector<float>&, int) {
  not_here();
}
