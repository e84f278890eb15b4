# The examples as a project of their own: cmake -S . -B build -DCMAKE_PREFIX_PATH=where Ledgerline was installed.
cmake_minimum_required(VERSION 3.25)
project(ledgerline_examples LANGUAGES C CXX)
find_package(Ledgerline 0.1 REQUIRED)
add_executable(client client.cpp)
target_link_libraries(client PRIVATE Ledgerline::client)
add_executable(chaincode chaincode.cpp)
target_link_libraries(chaincode PRIVATE Ledgerline::shim)
