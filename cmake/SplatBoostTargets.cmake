# SPDX-License-Identifier: Apache-2.0
# Functions that create this project's targets: one call per library, which also enforces the layers.
#
#   splatboost_library(NAME adapter_vanilla LAYER adapter SOURCES … PUBLIC_LINKS … PRIVATE_LINKS …)
#
# creates splatboost_adapter_vanilla with the alias splatboost::adapter_vanilla. A link to another
# splatboost:: target that the layer table does not allow stops the configure step.
include_guard(GLOBAL)

# layer -> the layers it may link to
set(SPLATBOOST_LAYER_core_device "")
set(SPLATBOOST_LAYER_core_projection core_device)
set(SPLATBOOST_LAYER_core_rasterizer core_device core_projection)
set(SPLATBOOST_LAYER_core_convexes core_device core_projection core_rasterizer)
set(SPLATBOOST_LAYER_core_points core_device core_projection)
set(SPLATBOOST_LAYER_core_geometry core_device core_projection)
set(SPLATBOOST_LAYER_core_loss core_device)
set(SPLATBOOST_LAYER_core_density core_device core_loss)
set(SPLATBOOST_LAYER_core_optim core_device core_projection)
set(SPLATBOOST_LAYER_core "")
set(SPLATBOOST_LAYER_adapter core adapter)  # an adapter may build on another
set(SPLATBOOST_LAYER_trainer_support core)
set(SPLATBOOST_LAYER_trainer_images core trainer_support)
set(SPLATBOOST_LAYER_trainer_dataset core trainer_support trainer_images)
set(SPLATBOOST_LAYER_trainer_sequence core trainer_support trainer_images)
set(SPLATBOOST_LAYER_trainer_features core trainer_dataset)
set(SPLATBOOST_LAYER_trainer_points core trainer_support trainer_dataset trainer_features)
set(SPLATBOOST_LAYER_trainer_formats core trainer_support trainer_images trainer_dataset trainer_points)
set(SPLATBOOST_LAYER_trainer_synth core trainer_support trainer_images trainer_dataset trainer_points trainer_formats)
set(SPLATBOOST_LAYER_trainer_mesh core trainer_support)
set(SPLATBOOST_LAYER_trainer_backbone_api core trainer_support trainer_dataset)
set(SPLATBOOST_LAYER_trainer_evaluation core trainer_support trainer_images trainer_dataset trainer_backbone_api)
set(SPLATBOOST_LAYER_trainer_training core trainer_support trainer_dataset trainer_backbone_api trainer_evaluation)
set(SPLATBOOST_LAYER_trainer_report core trainer_support trainer_images trainer_evaluation)
set(SPLATBOOST_LAYER_family core trainer_support trainer_dataset trainer_sequence trainer_backbone_api family)  # what backbones of one kind share
set(SPLATBOOST_LAYER_backbone core trainer_support trainer_dataset trainer_mesh trainer_backbone_api family)
set(SPLATBOOST_LAYER_patch "")
set(SPLATBOOST_LAYER_backbone_table trainer_backbone_api backbone)
set(SPLATBOOST_LAYER_program core adapter trainer family backbone backbone_table patch program)
set(SPLATBOOST_LAYER_test core adapter trainer family backbone backbone_table patch program reference test)
set(SPLATBOOST_LAYER_reference "")

function(splatboost_target_options target)
  target_compile_features(${target} PUBLIC cxx_std_20)
  set_target_properties(${target} PROPERTIES CXX_EXTENSIONS OFF)
  # Traps and errno of math functions are never read; NaN and infinity keep their meaning.
  target_compile_options(${target} PRIVATE $<$<COMPILE_LANGUAGE:CXX>:-Wall;-Wextra;-Wpedantic;-Wshadow;-Wconversion;
    -Wno-sign-conversion;-fno-math-errno;-fno-trapping-math;
    $<$<BOOL:${SPLATBOOST_WARNINGS_AS_ERRORS}>:-Werror>>)
  # nvcc has its own warnings, and passes generated code to the host compiler, hence only -Wall there. Relaxed constexpr
  # lets kernels call constexpr host functions such as std::span's. Warning 20012 comes from GLM's defaulted functions.
  # -std is set explicitly: CMake 3.25 does not know C++20 for nvcc.
  target_compile_options(${target} PRIVATE $<$<COMPILE_LANGUAGE:CUDA>:-std=c++20;--expt-relaxed-constexpr;
    --diag-suppress=20012;-Xcompiler=-Wall;
    $<$<BOOL:${SPLATBOOST_WARNINGS_AS_ERRORS}>:--Werror=all-warnings>>)
  # GCC 12 wrongly warns of overlapping copies in "text" + std::string (GCC bug 105651, fixed in 13).
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
    target_compile_options(${target} PRIVATE $<$<COMPILE_LANGUAGE:CXX>:-Wno-restrict>)
  endif()
  if(SPLATBOOST_SANITIZE)
    target_compile_options(${target} PRIVATE
      $<$<COMPILE_LANGUAGE:CXX>:-fsanitize=${SPLATBOOST_SANITIZE};-fno-omit-frame-pointer;-fno-sanitize-recover=all>)
    if(SPLATBOOST_SANITIZE MATCHES "undefined")
      # These checks of every pointer double the build time, and AddressSanitizer finds invalid accesses anyway.
      target_compile_options(${target} PRIVATE
        $<$<COMPILE_LANGUAGE:CXX>:-fno-sanitize=null,alignment,object-size,vptr>)
    endif()
    target_link_options(${target} PUBLIC -fsanitize=${SPLATBOOST_SANITIZE})
  endif()
endfunction()

# The links are checked when all targets exist, so that the order of folders does not matter.
function(splatboost_check_layer target layer)
  set_property(TARGET ${target} PROPERTY SPLATBOOST_LAYER ${layer})
  cmake_language(EVAL CODE
    "cmake_language(DEFER DIRECTORY [[${PROJECT_SOURCE_DIR}]] CALL splatboost_check_links ${target} ${layer} ${ARGN})")
endfunction()

function(splatboost_check_links target layer)
  foreach(link IN LISTS ARGN)
    if(link MATCHES "^splatboost::(.+)$")
      if(NOT TARGET ${link})
        message(FATAL_ERROR "${target}: ${link} does not exist.")
      endif()
      get_target_property(real ${link} ALIASED_TARGET)
      get_target_property(other ${real} SPLATBOOST_LAYER)
      if(NOT other IN_LIST SPLATBOOST_LAYER_${layer})
        message(FATAL_ERROR "${target} is of layer '${layer}', which may not depend on ${link} (layer '${other}').")
      endif()
    endif()
  endforeach()
endfunction()

function(splatboost_library)
  cmake_parse_arguments(ARG "" "NAME;LAYER" "SOURCES;PUBLIC_LINKS;PRIVATE_LINKS" ${ARGN})
  set(target splatboost_${ARG_NAME})
  add_library(${target} STATIC ${ARG_SOURCES})
  add_library(splatboost::${ARG_NAME} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${ARG_NAME} POSITION_INDEPENDENT_CODE ON)
  target_link_libraries(${target} PUBLIC ${ARG_PUBLIC_LINKS} PRIVATE ${ARG_PRIVATE_LINKS})
  splatboost_target_options(${target})
  splatboost_check_layer(${target} ${ARG_LAYER} ${ARG_PUBLIC_LINKS} ${ARG_PRIVATE_LINKS})
endfunction()

function(splatboost_executable)
  cmake_parse_arguments(ARG "" "NAME;LAYER;OUTPUT" "SOURCES;LINKS" ${ARGN})
  add_executable(${ARG_NAME} ${ARG_SOURCES})
  if(ARG_OUTPUT)
    set_target_properties(${ARG_NAME} PROPERTIES OUTPUT_NAME ${ARG_OUTPUT})
  endif()
  target_link_libraries(${ARG_NAME} PRIVATE ${ARG_LINKS})
  splatboost_target_options(${ARG_NAME})
  splatboost_check_layer(${ARG_NAME} ${ARG_LAYER} ${ARG_LINKS})
endfunction()

# splatboost_adapter(NAME vanilla SOURCES … [USES mip_splatting …]): the library splatboost::adapter_vanilla of the folder
# adapters/vanilla. One of its sources defines `AdapterEntry vanilla_adapter_entry()` (adapters/registry/boost_settings.h).
function(splatboost_adapter)
  cmake_parse_arguments(ARG "" "NAME" "SOURCES;USES" ${ARGN})
  list(TRANSFORM ARG_USES PREPEND splatboost::adapter_)
  splatboost_library(NAME adapter_${ARG_NAME} LAYER adapter SOURCES ${ARG_SOURCES}
    PUBLIC_LINKS splatboost::core ${ARG_USES})
  target_include_directories(splatboost_adapter_${ARG_NAME} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/adapters>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/splatboost/adapters>)
  set_property(GLOBAL APPEND PROPERTY SPLATBOOST_ADAPTERS ${ARG_NAME})
endfunction()

# splatboost_backbone(NAME vanilla SOURCES … LINKS splatboost::gaussians …): the library splatboost::backbone_vanilla of the
# folder backbones/vanilla. One of its sources defines `BackboneEntry vanilla_entry()` (trainer/backbone_api/backbone_entry.h).
function(splatboost_backbone)
  cmake_parse_arguments(ARG "" "NAME" "SOURCES;LINKS;PRIVATE_LINKS" ${ARGN})
  splatboost_library(NAME backbone_${ARG_NAME} LAYER backbone SOURCES ${ARG_SOURCES}
    PUBLIC_LINKS splatboost::core splatboost::trainer_backbone_api ${ARG_LINKS} PRIVATE_LINKS ${ARG_PRIVATE_LINKS})
  set_property(GLOBAL APPEND PROPERTY SPLATBOOST_BACKBONES ${ARG_NAME})
endfunction()

# splatboost_table(NAME adapters PART adapter LAYER adapter ENTRY AdapterEntry SUFFIX _adapter_entry HEADER … ENTRIES vanilla …):
# the library splatboost::adapters, whose function `adapters()` returns the entries of all of ENTRIES.
function(splatboost_table)
  cmake_parse_arguments(ARG "" "NAME;FUNCTION;PART;LAYER;ENTRY;SUFFIX;HEADER" "ENTRIES;SOURCES;LINKS" ${ARGN})
  set(declarations "")
  set(calls "")
  foreach(entry IN LISTS ARG_ENTRIES)
    string(APPEND declarations "${ARG_ENTRY} ${entry}${ARG_SUFFIX}();\n")
    string(APPEND calls "${entry}${ARG_SUFFIX}(), ")
  endforeach()
  file(CONFIGURE OUTPUT ${ARG_NAME}.cpp @ONLY CONTENT [[
// Made by cmake/SplatBoostTargets.cmake.
#include "@ARG_HEADER@"

namespace splatboost {

@declarations@
const std::vector<@ARG_ENTRY@>& @ARG_FUNCTION@() {
  static const std::vector<@ARG_ENTRY@> entries = {@calls@};
  return entries;
}

}  // namespace splatboost
]])
  list(TRANSFORM ARG_ENTRIES PREPEND splatboost::${ARG_PART}_)
  splatboost_library(NAME ${ARG_NAME} LAYER ${ARG_LAYER}
    SOURCES ${ARG_SOURCES} ${CMAKE_CURRENT_BINARY_DIR}/${ARG_NAME}.cpp PUBLIC_LINKS ${ARG_ENTRIES} ${ARG_LINKS})
endfunction()

# Adds each folder in `root` (adapters/ or backbones/) that has a CMakeLists.txt, except those in ARGN. New backbones
# need no registration.
function(splatboost_add_folders kind root)
  file(GLOB found CONFIGURE_DEPENDS RELATIVE ${root} ${root}/*/CMakeLists.txt)
  list(TRANSFORM found REPLACE "/CMakeLists.txt$" "")
  list(REMOVE_ITEM found ${ARGN})
  foreach(folder IN LISTS found)
    add_subdirectory(${root}/${folder} ${CMAKE_CURRENT_BINARY_DIR}/${kind}/${folder})
  endforeach()
endfunction()

# The tables of the adapters and the backbones added so far: splatboost::adapters<suffix> and splatboost::backbones<suffix>.
function(splatboost_adapter_table suffix)
  get_property(names GLOBAL PROPERTY SPLATBOOST_ADAPTERS)
  splatboost_table(NAME adapters${suffix} FUNCTION adapters PART adapter LAYER adapter ENTRY AdapterEntry
    SUFFIX _adapter_entry HEADER registry/boost_settings.h ENTRIES ${names}
    SOURCES ${PROJECT_SOURCE_DIR}/adapters/registry/find_adapter.cpp)
endfunction()
function(splatboost_backbone_table suffix)
  get_property(names GLOBAL PROPERTY SPLATBOOST_BACKBONES)
  splatboost_table(NAME backbones${suffix} FUNCTION backbones PART backbone LAYER backbone_table ENTRY BackboneEntry
    SUFFIX _entry HEADER trainer/backbone_api/backbone_entry.h ENTRIES ${names} LINKS splatboost::trainer_backbone_api)
endfunction()
