# find_package(Ledgerline): Ledgerline::client (common/fabric/client/client.hpp) Ledgerline::shim (chaincode/shim/shim.hpp)
# and Ledgerline::drone_shim (onboard/shim/mapping.hpp).
include(CMakeFindDependencyMacro)
list(PREPEND CMAKE_MODULE_PATH ${CMAKE_CURRENT_LIST_DIR})  # FindMbedTLS
find_dependency(Threads)
find_dependency(fmt)
find_dependency(spdlog)
find_dependency(Protobuf)
find_dependency(OpenSSL)
find_dependency(MbedTLS)
find_dependency(gRPC CONFIG)
list(POP_FRONT CMAKE_MODULE_PATH)
include(${CMAKE_CURRENT_LIST_DIR}/LedgerlineTargets.cmake)
