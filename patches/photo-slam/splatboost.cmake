# SPDX-License-Identifier: Apache-2.0
# SplatBoost in the target gaussian_mapper. CMake finds an installed SplatBoost by -DCMAKE_PREFIX_PATH=PREFIX.
if(NOT TARGET splatboost::shared)
  find_package(SplatBoost REQUIRED COMPONENTS shared)
endif()
target_sources(gaussian_mapper PRIVATE
  ${CMAKE_CURRENT_LIST_DIR}/boost.cpp ${CMAKE_CURRENT_LIST_DIR}/boost.h ${CMAKE_CURRENT_LIST_DIR}/drawing.cpp
  ${CMAKE_CURRENT_LIST_DIR}/drawing.h ${CMAKE_CURRENT_LIST_DIR}/tensors.h)
target_link_libraries(gaussian_mapper splatboost::shared)
