/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file The C ABI of libsplatboost: the core's operations for other languages, without torch and without C++ types.
 *
 * Memory belongs to the caller: tensors are views, for inputs and outputs, and no function owns one. Only settling on a
 * GPU (sb_rasterizer_settle, sb_rasterizer_counts) uses tensors of an earlier call, the last forward. Tensors are dense
 * and row-major: other strides are an error, whose message names the tensor. All tensors of a call are on the call's
 * device. A pointer that may be NULL is marked "optional"; NULL means that the tensor is not given.
 *
 * On a GPU a call queues its work on the caller's stream and returns. It waits for the device if it returns a number to
 * the host (its comment then says "waits"), in a rasterizer's first forward and in the forward after a view that ran
 * out of room, and when it allocates or frees memory: when a workspace grows, and in scores, selections and neighbours.
 * Successive calls may use different streams: the library orders the work on state that they share. The current device
 * of the calling thread is restored on return. On a GPU tensor values are not checked for infinities and NaN.
 *
 * Every function that returns sb_status checks its arguments: NULL, negative or overflowing sizes, wrong types, shapes,
 * strides and devices give an error and leave the outputs unchanged or partly written; they never crash. It cannot
 * check whether the memory is as large as the shape says.
 *
 * Functions may be called from any thread; a handle may be used by one thread at a time. Terms (β, importance, VCD …)
 * are defined in the C++ headers in this folder, which each section names.
 */
#ifndef SPLATBOOST_C_API_H_
#define SPLATBOOST_C_API_H_

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(SPLATBOOST_BUILDS_C_API) && defined(__GNUC__)
#define SB_API __attribute__((visibility("default")))
#else
#define SB_API
#endif

/* ---- version and errors ---- */

/** Raised when a function or a struct changes in a way that breaks callers; also the library's soname. Stays 1
 *  until the first release, whatever changes. */
#define SB_ABI_VERSION 1

/** SB_ABI_VERSION that the library was built with. A caller compiled with another value must not use the library. */
SB_API int32_t sb_abi_version(void);
/** Version of SplatBoost, such as "0.1.0". */
SB_API const char* sb_version(void);

typedef int32_t sb_status;
enum {
  SB_OK = 0,
  SB_ERROR_ARGUMENT = 1, /**< an argument breaks its contract */
  SB_ERROR_NO_CUDA = 2,  /**< a CUDA device was requested, but the library or the machine has none */
  SB_ERROR_MEMORY = 3,   /**< out of memory; for GPU memory the message gives the requested and the free bytes */
  SB_ERROR_CALLBACK = 4, /**< a callback of the caller reported failure */
  SB_ERROR_INTERNAL = 5  /**< any other error: a failure of the GPU, or a bug in the library */
};

/** Message of this thread's last failed call: one line, never NULL. Valid until this thread's next failure. */
SB_API const char* sb_last_error(void);

/* ---- devices and tensors ---- */

enum { SB_CPU = 0, SB_CUDA = 1 };

/** Where a call runs. A NULL sb_device* means the CPU with threads = 0. */
typedef struct sb_device {
  int32_t kind;    /**< SB_CPU or SB_CUDA */
  int32_t index;   /**< CUDA device number; 0 on the CPU */
  int32_t threads; /**< CPU threads; 0: one per CPU that the process may use, by its affinity mask and the
                        quotas of its control groups. Results do not depend on it */
  void* stream;    /**< cudaStream_t that the call is queued on, NULL for the default one; NULL on the CPU */
} sb_device;

/** 1 if this library can run on that kind of device here, else 0. */
SB_API int32_t sb_has_device(int32_t kind);
/** Compute capabilities that the library was built for, such as "7.5, 9.0"; "" if it was built without CUDA. */
SB_API const char* sb_cuda_architectures(void);
/** Process-wide counts of events that must not happen in a training loop; each pointer is optional.
 *  @param allocations of device memory and of pinned host memory @param waits of the host for a device */
SB_API sb_status sb_cuda_activity(int64_t* allocations, int64_t* waits);

enum { SB_FLOAT32 = 0, SB_FLOAT64 = 1, SB_INT32 = 2, SB_INT64 = 3, SB_UINT8 = 4 };

#define SB_MAX_DIMENSIONS 4

/** A view of the caller's memory; the library never frees it. */
typedef struct sb_tensor {
  void* data;         /**< aligned for its type; may be NULL only where there are no elements */
  int32_t type;       /**< SB_FLOAT32 … */
  int32_t dimensions; /**< 0 .. SB_MAX_DIMENSIONS */
  int64_t shape[SB_MAX_DIMENSIONS];
  int64_t strides[SB_MAX_DIMENSIONS]; /**< in elements; must be those of a dense row-major tensor */
  int32_t device_kind;                /**< SB_CPU or SB_CUDA */
  int32_t device_index;
} sb_tensor;

/* ---- rasterizer (rasterizer.h, gaussians.h, camera.h) ---- */

/** Pinhole, COLMAP's frame: x right, y down, z forward; the centre of pixel (column i, row j) is (i + 0.5, j + 0.5). */
typedef struct sb_camera {
  int32_t width, height;       /**< pixels, at most 2^20 each, and at most 2^24 tiles of 16 × 16 pixels */
  float fx, fy, cx, cy;        /**< pixels */
  float camera_from_world[16]; /**< rigid 4×4 (checked), row-major; points are column vectors, so entries 3, 7, 11 are
                                  the translation */
} sb_camera;

/** N activated Gaussians, float32. Give either scales and rotations or covariances, and either sh_dc (with sh_rest) or
 *  colors. */
typedef struct sb_gaussians {
  const sb_tensor* means;       /**< [N,3] world */
  const sb_tensor* scales;      /**< [N,3] standard deviations, world units */
  const sb_tensor* rotations;   /**< [N,4] quaternions (w,x,y,z), normalised; not drawn if shorter than 1e-18 or
                                     longer than 1e19 */
  const sb_tensor* covariances; /**< [N,6] xx xy xz yy yz zz */
  const sb_tensor* opacities;   /**< [N] or [N,1] */
  const sb_tensor* sh_dc;       /**< [N,3] or [N,1,3] */
  const sb_tensor* sh_rest;     /**< [N,R,3]; optional: R = 0 */
  const sb_tensor* colors;      /**< [N,3] */
  const sb_tensor* features;    /**< [N,F] extra channels, F <= 8; optional */
  int32_t sh_degree;            /**< active degree 0 .. 3, (degree + 1)² - 1 <= R */
} sb_gaussians;

enum { SB_BOX_SQUARE = 0, SB_BOX_ELLIPSE = 1 };

typedef struct sb_raster_options {
  int32_t box;                /**< SB_BOX_SQUARE: 3DGS's 3σ square; SB_BOX_ELLIPSE: the compact box */
  float beta;                 /**< (0,1], used by the compact box only */
  float low_pass;             /**< px², added to both variances: 0.3 in 3DGS, the kernel size in Mip-Splatting */
  int32_t compensate_opacity; /**< 1: opacity × sqrt(det Σ / det(Σ + low-pass)): antialiasing, Mip filter */
  float near_plane;           /**< world units; 0.2 in 3DGS */
  float background[3];
} sb_raster_options;

/** Fills in the options of 3DGS as published. */
SB_API sb_status sb_raster_options_default(sb_raster_options* options);

/** Outputs of a forward pass; NULL is not computed. */
typedef struct sb_raster_outputs {
  const sb_tensor* color;         /**< float32 [3,H,W], background added, not clamped */
  const sb_tensor* features;      /**< float32 [F,H,W] */
  const sb_tensor* inverse_depth; /**< float32 [1,H,W] Σ wᵢ / zᵢ */
  const sb_tensor* alpha;         /**< float32 [1,H,W] 1 − final transmittance */
  const sb_tensor* radii;         /**< int32 [N] 3σ radius in px, rounded up; 0 where not visible */
  const sb_tensor* visible;       /**< uint8 [N] 1 where listed in at least one tile */
} sb_raster_outputs;

/** Gradients of the loss with respect to the images: float32, shapes as the images; NULL means zero. */
typedef struct sb_image_gradients {
  const sb_tensor* color;
  const sb_tensor* features;
  const sb_tensor* inverse_depth;
  const sb_tensor* alpha;
} sb_image_gradients;

/** Outputs of a backward pass: float32, shapes as the inputs; NULL means not wanted. */
typedef struct sb_gaussian_gradients {
  int32_t accumulate; /**< 0: overwrite; 1: add (screen_means and screen_means_abs are overwritten in any case) */
  const sb_tensor* means;
  const sb_tensor* scales;
  const sb_tensor* rotations; /**< through the normalisation */
  const sb_tensor* covariances;
  const sb_tensor* opacities;
  const sb_tensor* sh_dc;
  const sb_tensor* sh_rest;
  const sb_tensor* colors;
  const sb_tensor* features;
  const sb_tensor* screen_means;     /**< [N,2] with respect to the mean on screen, in pixels */
  const sb_tensor* screen_means_abs; /**< [N,2] sum over pixels of its absolute value, for x and y separately (AbsGS) */
} sb_gaussian_gradients;

/** Workspace of one view; it grows as needed and is kept. backward and the counts refer to the last forward. */
typedef struct sb_rasterizer sb_rasterizer;

/** @param device where all calls with the handle run; its stream is not kept
 *  @param rasterizer receives the handle, which the caller frees by sb_rasterizer_destroy */
SB_API sb_status sb_rasterizer_create(const sb_device* device, sb_rasterizer** rasterizer);
/** Frees the handle; NULL is allowed. */
SB_API void sb_rasterizer_destroy(sb_rasterizer* rasterizer);

/** On a GPU a view that needs more memory for its tile lists than earlier views is drawn without some of its splats
 *  (rasterizer.h). A training loop can tolerate this; elsewhere call sb_rasterizer_settle, which redraws such a view.
 *  @param stream cudaStream_t of this call; NULL on the CPU */
SB_API sb_status sb_rasterizer_forward(sb_rasterizer* rasterizer, const sb_camera* camera,
                                       const sb_gaussians* gaussians, const sb_raster_options* options,
                                       const sb_raster_outputs* outputs, void* stream);
/** Gradients of the last forward. @param gaussians those of the last forward, unchanged */
SB_API sb_status sb_rasterizer_backward(sb_rasterizer* rasterizer, const sb_gaussians* gaussians,
                                        const sb_image_gradients* image_gradients,
                                        const sb_gaussian_gradients* gradients, void* stream);
/** Adds to counts[i] the number of flagged pixels where Gaussian i was blended in the last forward (paper eq. 9), by
 *  replaying its tile lists. @param flagged uint8 [H,W] @param counts int32 [N] */
SB_API sb_status sb_rasterizer_count_flagged(sb_rasterizer* rasterizer, const sb_tensor* flagged,
                                             const sb_tensor* counts, void* stream);
/** Adds to counts[i] the number of pixels where Gaussian i was blended in the last forward while the transmittance in
 *  front of it was above min_transmittance: the pixels that observe it (PGSR: 0.5). @param counts int32 [N] */
SB_API sb_status sb_rasterizer_count_observed(sb_rasterizer* rasterizer, float min_transmittance,
                                              const sb_tensor* counts, void* stream);
/** Adds each Gaussian's blending weights in the last forward, summed over pixels, in units of 1/256; a sum stops at
 *  2^31 - 1 (Rasterizer::add_weights). @param weights int32 [N] */
SB_API sb_status sb_rasterizer_add_weights(sb_rasterizer* rasterizer, const sb_tensor* weights, void* stream);
/** For scores and evaluation, where every splat counts: waits for the last forward and, if it ran out of room, redraws
 *  it into the same images. The tensors of that call must still exist, unchanged. Does nothing on the CPU.
 *  @param redrawn optional, receives 1 if the view was redrawn, else 0 */
SB_API sb_status sb_rasterizer_settle(sb_rasterizer* rasterizer, int32_t* redrawn, void* stream);
/** Counts of the last forward, which it settles first (waits); each pointer is optional.
 *  @param visible Gaussians listed in at least one tile @param entries (tile, Gaussian) pairs */
SB_API sb_status sb_rasterizer_counts(sb_rasterizer* rasterizer, int64_t* visible, int64_t* entries, void* stream);

/* ---- rasterizer of smooth convexes (convex_rasterizer.h, convexes.h) ---- */

/** N activated convexes of K points each (3 to 8), float32. Give either sh_dc (with sh_rest) or colors. */
typedef struct sb_convexes {
  const sb_tensor* points;     /**< [N,K,3] world */
  const sb_tensor* smoothness; /**< [N] or [N,1] δ (convexes.h) */
  const sb_tensor* sharpness;  /**< [N] or [N,1] σ */
  const sb_tensor* opacities;  /**< [N] or [N,1] */
  const sb_tensor* sh_dc;      /**< [N,3] or [N,1,3] */
  const sb_tensor* sh_rest;    /**< [N,R,3]; optional: R = 0 */
  const sb_tensor* colors;     /**< [N,3] */
  int32_t sh_degree;           /**< active degree 0 .. 3, (degree + 1)² - 1 <= R */
} sb_convexes;

enum { SB_CONVEX_BOX_SQUARE = 0, SB_CONVEX_BOX_COMPACT = 1 };

typedef struct sb_convex_options {
  int32_t box;      /**< SB_CONVEX_BOX_SQUARE: the released square; SB_CONVEX_BOX_COMPACT: the compact box */
  float beta;       /**< (0,1], used by the compact box only */
  float near_plane; /**< world units; 0.2 in the release */
  float pixel_size; /**< side of a pixel, in the pixels that δ and σ refer to: 1 in the release */
  float background[3];
  int32_t released_view_direction; /**< 1: view direction of the SH as the release mistakenly computes it */
} sb_convex_options;

/** Outputs of a forward pass; color is required. */
typedef struct sb_convex_outputs {
  const sb_tensor* color;   /**< float32 [3,H,W], background added, not clamped */
  const sb_tensor* alpha;   /**< float32 [1,H,W] 1 − final transmittance; optional */
  const sb_tensor* visible; /**< uint8 [N] 1 where listed in at least one tile; optional */
} sb_convex_outputs;

/** Outputs of a backward pass: float32, shapes as the inputs; NULL means not wanted. */
typedef struct sb_convex_gradients {
  int32_t accumulate; /**< 0: overwrite; 1: add (screen_points and sharpness_abs are overwritten in any case) */
  const sb_tensor* points;
  const sb_tensor* smoothness;
  const sb_tensor* sharpness;
  const sb_tensor* opacities;
  const sb_tensor* sh_dc;
  const sb_tensor* sh_rest;
  const sb_tensor* colors;
  const sb_tensor* sharpness_abs; /**< [N] sum over pixels of the absolute gradient of the sharpness */
  const sb_tensor* screen_points; /**< [N,3] with respect to the points on screen, in pixels, summed over the convex's
                                       points: Σ ∂x, Σ ∂y, Σ (|∂x| + |∂y|) */
} sb_convex_gradients;

/** Workspace of one view of convexes; its functions are like those of sb_rasterizer, for convexes. */
typedef struct sb_convex_rasterizer sb_convex_rasterizer;

/** @param rasterizer receives the handle, which the caller frees by sb_convex_rasterizer_destroy */
SB_API sb_status sb_convex_rasterizer_create(const sb_device* device, sb_convex_rasterizer** rasterizer);
/** Frees the handle; NULL is allowed. */
SB_API void sb_convex_rasterizer_destroy(sb_convex_rasterizer* rasterizer);
/** On a GPU it waits to read back the number of (tile, convex) pairs; every convex is drawn. */
SB_API sb_status sb_convex_rasterizer_forward(sb_convex_rasterizer* rasterizer, const sb_camera* camera,
                                              const sb_convexes* convexes, const sb_convex_options* options,
                                              const sb_convex_outputs* outputs, void* stream);
/** @param convexes those of the last forward, unchanged @param color,alpha gradients of the images; NULL means zero */
SB_API sb_status sb_convex_rasterizer_backward(sb_convex_rasterizer* rasterizer, const sb_convexes* convexes,
                                               const sb_tensor* color, const sb_tensor* alpha,
                                               const sb_convex_gradients* gradients, void* stream);
/** @param flagged uint8 [H,W] @param counts int32 [N] */
SB_API sb_status sb_convex_rasterizer_count_flagged(sb_convex_rasterizer* rasterizer, const sb_tensor* flagged,
                                                    const sb_tensor* counts, void* stream);
/** @param weights int32 [N] */
SB_API sb_status sb_convex_rasterizer_add_weights(sb_convex_rasterizer* rasterizer, const sb_tensor* weights,
                                                  void* stream);

/* ---- visibility (visibility.h) ---- */

/** Marks the means that lie beyond the near plane (3DGS: markVisible). @param means float32 [N,3]
 *  @param visible uint8 [N] receives 1 or 0 */
SB_API sb_status sb_mark_visible(const sb_device* device, const sb_camera* camera, const sb_tensor* means,
                                 float near_plane, const sb_tensor* visible);
/** Screen radii of the Gaussians whose 3σ square meets the image, without drawing (Scaffold-GS: visible_filter). Reads
 *  only means, and scales with rotations, or covariances. @param radii int32 [N] as sb_raster_outputs::radii */
SB_API sb_status sb_visible_radii(const sb_device* device, const sb_camera* camera, const sb_gaussians* gaussians,
                                  const sb_raster_options* options, const sb_tensor* radii);

/* ---- errors and losses (error_map.h, photometric.h, ssim.h) ---- */

/** Ground-truth image of a view, 8 bit. */
typedef struct sb_truth {
  const sb_tensor* color; /**< uint8 [3,H,W] */
  const sb_tensor* valid; /**< uint8 [H,W], non-zero where the pixel counts; optional: all do */
} sb_truth;

/** Flags pixels with a large min-max normalised error (paper eqs. 6-8); waits. @param render float32 [3,H,W]
 *  @param error float32 [H,W] receives the error @param flagged uint8 [H,W] receives 1 or 0
 *  @param count optional, receives the number of flagged pixels */
SB_API sb_status sb_flag_errors(const sb_device* device, const sb_tensor* render, const sb_truth* truth, float tau,
                                const sb_tensor* error, const sb_tensor* flagged, int64_t* count);

typedef struct sb_loss {
  double l1, ssim, total;
} sb_loss;

/** (1−λ)·L1 + λ·(1−SSIM) (paper eq. 10); waits. @param render float32 [3,H,W]
 *  @param gradient float32 [3,H,W] with respect to the render; optional */
SB_API sb_status sb_photometric_loss(const sb_device* device, const sb_tensor* render, const sb_truth* truth,
                                     float lambda_dssim, const sb_tensor* gradient, sb_loss* loss);

/** Mean SSIM of float images, as fused_ssim computes it. @param images,truths float32 [B,C,H,W]
 *  @param valid_padding 0: windows are padded with zeros ("same"); 1: only windows within the image ("valid"; H and W
 *  must exceed 10) @param gradient float32 [B,C,H,W] of the mean with respect to images; optional
 *  @param mean float64 [1] */
SB_API sb_status sb_ssim(const sb_device* device, const sb_tensor* images, const sb_tensor* truths,
                         int32_t valid_padding, const sb_tensor* gradient, const sb_tensor* mean);

/* ---- scores and selections (scores.h, select.h) ---- */

/** Importance s⁺ (paper eq. 9). @param counts int64 [N] Σ_j n_ij over the views @param scores int64 [N] */
SB_API sb_status sb_importance_scores(const sb_device* device, const sb_tensor* counts, int32_t views,
                                      const sb_tensor* scores);
/** Pruning score s⁻ (paper eq. 11). @param weighted_counts float64 [N] Σ_j E_j·n_ij, finite
 *  @param scores float32 [N] */
SB_API sb_status sb_pruning_scores(const sb_device* device, const sb_tensor* weighted_counts, const sb_tensor* scores);
/** VCD: keeps the candidates whose importance is above the threshold; waits. @param importance int64 [N]
 *  @param candidates uint8 [N], the others are cleared @param kept optional, receives the number kept */
SB_API sb_status sb_keep_important(const sb_device* device, const sb_tensor* importance, double threshold,
                                   const sb_tensor* candidates, int64_t* kept);
/** VCP: keeps `keep` of the candidates, drawn by weight without replacement. @param weights float32 [N]
 *  @param candidates uint8 [N], the others are cleared @param seed,iteration determine the random numbers */
SB_API sb_status sb_keep_weighted_sample(const sb_device* device, const sb_tensor* weights, int64_t keep, uint64_t seed,
                                         uint64_t iteration, const sb_tensor* candidates);
/** Keeps the `keep` candidates of the largest priority. @param priorities float32 [N]
 *  @param candidates uint8 [N], the others are cleared */
SB_API sb_status sb_keep_largest(const sb_device* device, const sb_tensor* priorities, int64_t keep,
                                 const sb_tensor* candidates);
/** If all are selected, deselects the one of the largest priority; waits. @param priorities float32 [N]
 *  @param removals uint8 [N] @param removed optional, receives the number selected afterwards */
SB_API sb_status sb_spare_one(const sb_device* device, const sb_tensor* priorities, const sb_tensor* removals,
                              int64_t* removed);

/* ---- optimizer, neighbours, clearance, schedule (adam.h, neighbors.h, clearance.h, schedule.h) ---- */

typedef struct sb_adam_options {
  float learning_rate, beta1, beta2, epsilon;
} sb_adam_options;

/** One Adam step; it sets the gradients to zero. All tensors are float32, of 1 to 4 dimensions and the same number of
 *  elements. @param step number of this step, from 1 */
SB_API sb_status sb_adam_step(const sb_device* device, const sb_tensor* values, const sb_tensor* gradients,
                              const sb_tensor* first_moments, const sb_tensor* second_moments, int64_t step,
                              const sb_adam_options* options);

/** Mean squared distance of each point to its k nearest others; simple_knn's distCUDA2 with k = 3.
 *  @param points float32 [N,3] @param k 1 .. 64, on a GPU 1 .. 8 @param distances float32 [N] */
SB_API sb_status sb_mean_squared_neighbor_distances(const sb_device* device, const sb_tensor* points, int32_t k,
                                                    const sb_tensor* distances);

/** Distances of cameras to the scene's nearest points, world units; max(10, M / max(1000, 10 C)) points may be nearer,
 *  because some may be wrong. Points that fill their bounding box evenly are taken as drawn at random, which show no
 *  surface; nor do fewer than 64 points. Computed on the host; waits.
 *  @param centres float32 [C,3] of all training cameras @param points float32 [M,3] of the scene before training
 *  @param distances float32 [C]; 0 if no surface is known */
SB_API sb_status sb_distances_to_scene(const sb_device* device, const sb_tensor* centres, const sb_tensor* points,
                                       const sb_tensor* distances);
/** Distances of Gaussians from cameras, relative to those of the scene: the least over the cameras.
 *  @param means float32 [N,3] @param centres float32 [C,3]
 *  @param distances float32 [C] of sb_distances_to_scene(); cameras at distance 0 are left out
 *  @param clearances float32 [N]; infinite if no camera is left */
SB_API sb_status sb_camera_clearances(const sb_device* device, const sb_tensor* means, const sb_tensor* centres,
                                      const sb_tensor* distances, const sb_tensor* clearances);

/** Interval of a parameter group's steps in each phase; early_end and middle_end are iterations of the published run
 *  (30 000 iterations). */
typedef struct sb_step_intervals {
  int32_t early, middle, late, early_end, middle_end;
} sb_step_intervals;

/** @param steps receives 1 if the group steps at this iteration (from 1) of a run of `total`, else 0 */
SB_API sb_status sb_steps_at(const sb_step_intervals* intervals, int32_t iteration, int32_t total, int32_t* steps);
/** The iteration of a run of `total` that corresponds to `published` of one of `published_total`. */
SB_API sb_status sb_scaled_iteration(int32_t published, int32_t total, int32_t published_total, int32_t* iteration);
/** Log-linear interpolation from `initial` at iteration 0 to `final_value` at `steps` and after. */
SB_API sb_status sb_exponential_rate(double initial, double final_value, int32_t iteration, int32_t steps,
                                     double* rate);

#ifdef __cplusplus
}
#endif

#endif /* SPLATBOOST_C_API_H_ */
