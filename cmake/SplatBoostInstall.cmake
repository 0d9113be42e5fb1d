# SPDX-License-Identifier: Apache-2.0
# The install rules, and the package that find_package(SplatBoost) finds.
include_guard(GLOBAL)
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

get_property(adapters GLOBAL PROPERTY SPLATBOOST_ADAPTERS)
list(TRANSFORM adapters PREPEND splatboost_adapter_)
install(TARGETS splatboost_core ${adapters} splatboost_adapters
  EXPORT SplatBoostCoreTargets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(TARGETS splatboost_shared EXPORT SplatBoostSharedTargets LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(DIRECTORY ${PROJECT_SOURCE_DIR}/core/include/splatboost DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(DIRECTORY ${PROJECT_SOURCE_DIR}/adapters/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/splatboost/adapters
  FILES_MATCHING PATTERN "*.h" PATTERN c_api_edge.h EXCLUDE PATTERN python EXCLUDE)
if(TARGET splatboost_program)
  install(TARGETS splatboost_program RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/patches/ DESTINATION ${CMAKE_INSTALL_DATADIR}/splatboost/patches
    PATTERN tool EXCLUDE)
endif()

set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/SplatBoost)
foreach(component Core Shared)
  install(EXPORT SplatBoost${component}Targets NAMESPACE splatboost:: DESTINATION ${package_folder})
endforeach()
configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/SplatBoostConfig.cmake.in
  ${PROJECT_BINARY_DIR}/SplatBoostConfig.cmake INSTALL_DESTINATION ${package_folder})
# Before 1.0 a minor version may change an interface.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/SplatBoostConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/SplatBoostConfig.cmake ${PROJECT_BINARY_DIR}/SplatBoostConfigVersion.cmake
  DESTINATION ${package_folder})
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/splatboost)
