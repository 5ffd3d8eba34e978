# Binary, library, headers, weights, and a CMake package: find_package(ecir) gives ecir::ecir.
include(CMakePackageConfigHelpers)
set(ecir_package ${CMAKE_INSTALL_LIBDIR}/cmake/ecir)
set(ecir_weights ${CMAKE_INSTALL_DATADIR}/ecir/weights)

target_compile_features(ecir INTERFACE cxx_std_20)
# Header-only libraries are compiled in; who links the installed library does not need them.
get_target_property(links ecir INTERFACE_LINK_LIBRARIES)
list(FILTER links EXCLUDE REGEX "Eigen3::|nlohmann_json::")
set_target_properties(ecir PROPERTIES INTERFACE_LINK_LIBRARIES "${links}")
# For BUILD_SHARED_LIBS: the installation works from wherever it is moved to.
file(RELATIVE_PATH to_library /${CMAKE_INSTALL_BINDIR} /${CMAKE_INSTALL_LIBDIR})
set_target_properties(ecir_tool PROPERTIES INSTALL_RPATH "$ORIGIN/${to_library}")

install(TARGETS ecir EXPORT ecirTargets)
install(TARGETS ecir_tool)
# Under include/ecir as in the source tree, since headers name each other from its root.
install(DIRECTORY runtime layers weights DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/ecir
  FILES_MATCHING PATTERN "*.hpp")
install(DIRECTORY weights/ DESTINATION ${ecir_weights}
  FILES_MATCHING PATTERN "*.safetensors" PATTERN "*.json" PATTERN "*.md")
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})

install(EXPORT ecirTargets NAMESPACE ecir:: DESTINATION ${ecir_package})
configure_package_config_file(cmake/ecirConfig.cmake.in ${CMAKE_CURRENT_BINARY_DIR}/ecirConfig.cmake
  INSTALL_DESTINATION ${ecir_package} PATH_VARS ecir_weights)
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/ecirConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/ecirConfig.cmake
  ${CMAKE_CURRENT_BINARY_DIR}/ecirConfigVersion.cmake
  DESTINATION ${ecir_package})
