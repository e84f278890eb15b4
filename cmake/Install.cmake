# `cmake --install` gives other projects the client and the shims as a CMake package: docs/library.md. Headers keep their paths of
# this tree below include/ledgerline, so the examples are the same files here and there. Programs: packaging/CMakeLists.txt.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(public_headers common/crypto/crypto.hpp common/fabric/blocks/checkpoint.hpp
  common/fabric/client/client.hpp common/fabric/calls/outcome.hpp common/fabric/tx/transaction.hpp common/rt/clock.hpp
  common/base/result.hpp chaincode/shim/shim.hpp
  common/msg/contract.hpp common/msg/onboard.hpp common/rt/spsc_ring.hpp
  onboard/shim/mapping.hpp)
foreach(header ${public_headers})
  get_filename_component(folder ${header} DIRECTORY)
  install(FILES ${header} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/ledgerline/${folder} COMPONENT dev)
endforeach()

set_target_properties(ledgerline_fabric_client PROPERTIES EXPORT_NAME client)
set_target_properties(ledgerline_shim PROPERTIES EXPORT_NAME shim)
set_target_properties(ledgerline_drone_shim PROPERTIES EXPORT_NAME drone_shim)
foreach(target ledgerline_fabric_client ledgerline_shim ledgerline_drone_shim)
  target_compile_features(${target} INTERFACE cxx_std_20)
endforeach()
set(dev ledgerline_fabric_client ledgerline_shim ledgerline_drone_shim ledgerline_msg
  ledgerline_fabric_blocks ledgerline_fabric_tls_server ledgerline_fabric_tx ledgerline_crypto ledgerline_base ledgerline_rt ledgerline_shim_session
  fabric_protos fabric_grpc)
add_custom_target(install_dev DEPENDS ${dev})
install(TARGETS ${dev}
  EXPORT LedgerlineTargets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev
  INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/ledgerline)
set(package ${CMAKE_INSTALL_LIBDIR}/cmake/Ledgerline)
install(EXPORT LedgerlineTargets NAMESPACE Ledgerline:: DESTINATION ${package} COMPONENT dev)
write_basic_package_version_file(${CMAKE_BINARY_DIR}/LedgerlineConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES cmake/LedgerlineConfig.cmake cmake/FindMbedTLS.cmake ${CMAKE_BINARY_DIR}/LedgerlineConfigVersion.cmake
  DESTINATION ${package} COMPONENT dev)

set(examples ${CMAKE_INSTALL_DATADIR}/ledgerline/examples)
install(FILES common/fabric/example.cpp DESTINATION ${examples} RENAME client.cpp COMPONENT dev)
install(FILES chaincode/shim/example.cpp DESTINATION ${examples} RENAME chaincode.cpp COMPONENT dev)
install(FILES hil/shim/example.cpp DESTINATION ${examples} RENAME drones.cpp COMPONENT dev)
install(FILES cmake/examples.cmake DESTINATION ${examples} RENAME CMakeLists.txt COMPONENT dev)
# Your own code under test (docs/faults.md): the interface of plug-ins, and an example.
install(FILES ground/plugin/controller_plugin.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/ledgerline/ground/plugin COMPONENT dev)
install(FILES ground/plugin/example.cpp DESTINATION ${examples} RENAME controller.cpp COMPONENT dev)
