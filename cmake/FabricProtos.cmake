# fabric_protos: Fabric's messages as C++; fabric_grpc: its services. Sources are made from descriptors fetched by
# fabric_protos.py at configure time and kept in build/deps, shared by all presets.
set(FABRIC_DESC ${CMAKE_SOURCE_DIR}/build/deps/fabric.desc)
if(NOT EXISTS ${FABRIC_DESC})
  find_package(Python3 REQUIRED COMPONENTS Interpreter)
  message(STATUS "Fetching Fabric's protobuf descriptors")
  execute_process(COMMAND ${Python3_EXECUTABLE} ${CMAKE_SOURCE_DIR}/cmake/fabric_protos.py ${FABRIC_DESC}
    COMMAND_ERROR_IS_FATAL ANY)
endif()

set(GENERATED ${CMAKE_BINARY_DIR}/generated)
file(MAKE_DIRECTORY ${GENERATED})
set(WKT_DESC ${GENERATED}/wkt.desc)
foreach(dir ${Protobuf_INCLUDE_DIRS} /usr/include)
  if(EXISTS ${dir}/google/protobuf/timestamp.proto)
    set(WKT_DIR ${dir})
    break()
  endif()
endforeach()
add_custom_command(OUTPUT ${WKT_DESC}
  COMMAND protobuf::protoc -I ${WKT_DIR} --include_imports -o ${WKT_DESC}
    google/protobuf/timestamp.proto google/protobuf/empty.proto google/protobuf/duration.proto google/protobuf/any.proto)

set(FABRIC_MESSAGES
  common/common common/configtx common/configuration common/ledger common/policies
  gateway/gateway
  ledger/queryresult/kv_query_result ledger/rwset/rwset ledger/rwset/kvrwset/kv_rwset
  msp/identities msp/msp_config msp/msp_principal
  orderer/ab orderer/configuration
  peer/lifecycle/chaincode_definition peer/lifecycle/db peer/lifecycle/lifecycle
  peer/chaincode peer/chaincode_event peer/chaincode_shim peer/events peer/peer peer/policy peer/proposal
  peer/proposal_response peer/collection peer/transaction peer/query)
set(FABRIC_SERVICES gateway/gateway orderer/ab peer/events peer/peer peer/chaincode_shim)

# Generated code is not what the sanitizers look for. With tsan its classes have another layout, though: there all must
# be compiled with it.
set(GENERATED_OPTIONS -O1)
if(LEDGERLINE_SANITIZE STREQUAL "thread")
  set(GENERATED_OPTIONS -O0)
elseif(LEDGERLINE_SANITIZE)
  set(GENERATED_OPTIONS -O1 -fno-sanitize=all)
endif()

set(message_sources)
set(message_protos)
foreach(proto ${FABRIC_MESSAGES})
  list(APPEND message_sources ${GENERATED}/${proto}.pb.cc)
  list(APPEND message_headers ${GENERATED}/${proto}.pb.h)
  list(APPEND message_protos ${proto}.proto)
endforeach()
# The lite runtime: nobody reflects on these messages, and unknown fields, of which anybody can send megabytes, cost it
# less than half.
add_custom_command(OUTPUT ${message_sources} ${message_headers}
  COMMAND protobuf::protoc --descriptor_set_in=${FABRIC_DESC}:${WKT_DESC} --cpp_out=lite:${GENERATED} ${message_protos}
  DEPENDS ${FABRIC_DESC} ${WKT_DESC})
add_library(fabric_protos STATIC ${message_sources})
target_include_directories(fabric_protos SYSTEM PUBLIC $<BUILD_INTERFACE:${GENERATED}>)
target_link_libraries(fabric_protos PUBLIC protobuf::libprotobuf)
target_compile_options(fabric_protos PRIVATE -w ${GENERATED_OPTIONS})

if(LEDGERLINE_NETWORK_PARTS)
  set(service_sources)
  set(service_protos)
  foreach(proto ${FABRIC_SERVICES})
    list(APPEND service_sources ${GENERATED}/${proto}.grpc.pb.cc)
    list(APPEND service_protos ${proto}.proto)
  endforeach()
  add_custom_command(OUTPUT ${service_sources}
    COMMAND protobuf::protoc --descriptor_set_in=${FABRIC_DESC}:${WKT_DESC}
      --plugin=protoc-gen-grpc=${GRPC_CPP_PLUGIN} --grpc_out=${GENERATED} ${service_protos}
    DEPENDS ${FABRIC_DESC} ${WKT_DESC})
  add_library(fabric_grpc STATIC ${service_sources})
  target_link_libraries(fabric_grpc PUBLIC fabric_protos gRPC::grpc++ absl::synchronization)
  target_compile_options(fabric_grpc PRIVATE -w ${GENERATED_OPTIONS})
endif()
