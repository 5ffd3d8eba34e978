# Binary, library, headers, weights, and a CMake package: find_package(ecir) gives ecir::ecir.
include(CMakePackageConfigHelpers)
install(TARGETS ecir ecir_tool EXPORT ecirTargets)
install(DIRECTORY runtime layers weights DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/ecir
  FILES_MATCHING PATTERN "*.hpp")
install(DIRECTORY weights/ DESTINATION ${CMAKE_INSTALL_DATADIR}/ecir/weights
  FILES_MATCHING PATTERN "*.safetensors" PATTERN "*.md")
install(EXPORT ecirTargets NAMESPACE ecir:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/ecir)
configure_package_config_file(cmake/ecirConfig.cmake.in ${CMAKE_CURRENT_BINARY_DIR}/ecirConfig.cmake
  INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/ecir)
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/ecirConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/ecirConfig.cmake
  ${CMAKE_CURRENT_BINARY_DIR}/ecirConfigVersion.cmake
  DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/ecir)
