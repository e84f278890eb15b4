# The kinds of target that this project has: library, program, test (also in a network namespace of its own), a page as text.

add_library(ledgerline_options INTERFACE)
target_compile_options(ledgerline_options INTERFACE
  -Wall -Wextra -Wpedantic -Wconversion -Wno-sign-conversion -Wnon-virtual-dtor -Werror
  $<$<AND:$<BOOL:${CMAKE_UNITY_BUILD}>,$<CXX_COMPILER_ID:GNU>>:-Wno-subobject-linkage>)  # of headers, for which it takes the sources of a unit

# For scripts/check-links: which files a target compiles and what it links, a line each in build/PRESET/targets.txt.
function(ll_note_target name)
  set_property(GLOBAL APPEND PROPERTY LEDGERLINE_TARGETS ${name})
endfunction()
function(ll_write_targets)
  get_property(targets GLOBAL PROPERTY LEDGERLINE_TARGETS)
  set(lines)
  foreach(target ${targets})
    get_target_property(folder ${target} SOURCE_DIR)
    get_target_property(sources ${target} SOURCES)
    get_target_property(links ${target} LINK_LIBRARIES)
    list(FILTER sources EXCLUDE REGEX "^/")
    list(TRANSFORM sources PREPEND "${folder}/")
    string(REPLACE "${CMAKE_SOURCE_DIR}/" "" sources "${sources}")
    string(REPLACE ";" " " line "${target}: ${sources} : ${links}")
    string(APPEND lines "${line}\n")
  endforeach()
  file(WRITE ${CMAKE_BINARY_DIR}/targets.txt "${lines}")
endfunction()

# ll_library(NAME SOURCES a.cpp ... DEPS other ...): a static library, included by path from the root ("common/rt/clock.hpp").
function(ll_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS;PRIVATE_DEPS" ${ARGN})
  add_library(${name} STATIC ${ARG_SOURCES})
  target_include_directories(${name} PUBLIC $<BUILD_INTERFACE:${CMAKE_SOURCE_DIR}>)
  ll_note_target(${name})
  # Not in tests: in a unity build they see each other's names. Nor by clang, which minds other sources' names, too.
  target_compile_options(${name} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-Wshadow>)
  target_link_libraries(${name} PUBLIC ${ARG_DEPS} PRIVATE $<BUILD_INTERFACE:ledgerline_options> ${ARG_PRIVATE_DEPS})
endfunction()

# Every program, no test; and every unit test with the programs that it runs. onboard_tests: those of
# what runs on a companion computer (docs/three-machines.md) that need none of the programs; they have the label `onboard`.
# threads_tests: those that start threads, so that tsan has something to find; they have the label `threads`.
add_custom_target(programs)
# part_tests: those that sanitizers run in every run. Release runs them without --all, with --long or by name alone (label `sanitized`),
# so they are not in `all`; but for those with the label `release`, which sanitizers get in the way of. The other tests have the
# label `long_sanitized`.
add_custom_target(part_tests)
add_custom_target(unit_tests)
add_dependencies(unit_tests part_tests)
# What ./run-tests builds: without the hostile bytes of tests/fuzz, which it leaves out.
add_custom_target(quick_tests)
add_custom_target(onboard_tests)
add_custom_target(threads_tests)

# ll_program(NAME SOURCES main.cpp DEPS its_library): a program in bin/, with the frame that all have (common/program).
function(ll_program name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  ll_note_target(${name})
  target_link_libraries(${name} PRIVATE ledgerline_options ledgerline_program ${ARG_DEPS})
  target_link_options(${name} PRIVATE LINKER:--as-needed)  # packages' CMake files name more libraries than are used
  add_dependencies(programs ${name})
endfunction()

# ll_verbs(NAME [APART] VERBS verb ... SOURCES ... DEPS ...): a program in libexec/ledgerline that has these verbs of `ledgerline`.
# APART: the verbs' files have names of their own, and are no unity.
function(ll_verbs name)
  cmake_parse_arguments(ARG "APART" "" "VERBS;SOURCES;DEPS" ${ARGN})
  set(ROWS)
  foreach(verb ${ARG_VERBS})
    string(REPLACE - _ function ${verb})
    list(APPEND ROWS "{\"${verb}\", command::${function}}")
  endforeach()
  list(JOIN ROWS ", " ROWS)
  set(main ${CMAKE_CURRENT_BINARY_DIR}/${name}.cpp)
  configure_file(${CMAKE_SOURCE_DIR}/tools/command/group.cpp.in ${main} @ONLY)
  ll_program(${name} SOURCES ${main} ${ARG_SOURCES} DEPS ${ARG_DEPS})
  target_include_directories(${name} PRIVATE ${CMAKE_SOURCE_DIR})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/libexec/ledgerline)
  if(ARG_APART)
    set_target_properties(${name} PROPERTIES UNITY_BUILD OFF)
  endif()
  add_dependencies(${name} ledgerline)
endfunction()

# ll_label_test(NAME LABEL...): the labels of a unit test, and which builds it is in.
function(ll_label_test name)
  add_dependencies(unit_tests ${name})
  if(NOT "fuzz" IN_LIST ARGN)
    add_dependencies(quick_tests ${name})
  endif()
  if(NOT "long_sanitized" IN_LIST ARGN)
    add_dependencies(part_tests ${name})
    if(NOT "release" IN_LIST ARGN)
      if(NOT CMAKE_CROSSCOMPILING AND NOT "threads" IN_LIST ARGN)
        target_compile_options(${name} PRIVATE $<$<CONFIG:Release>:-O0>)  # a third quicker to compile; the libraries are optimised
      endif()
      list(APPEND ARGN sanitized)
      set_target_properties(${name} PROPERTIES EXCLUDE_FROM_ALL ON)
    endif()
  endif()
  set_tests_properties(${name} PROPERTIES LABELS "unit;${ARGN}")
endfunction()

# ll_test(NAME SOURCES a_test.cpp DEPS ... [SERIAL] [TIMEOUT s] [LABELS ...]): a GoogleTest program, one ctest entry a program.
function(ll_test name)
  cmake_parse_arguments(ARG "SERIAL" "TIMEOUT" "SOURCES;DEPS;LABELS" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE ledgerline_options ${ARG_DEPS} GTest::gtest GTest::gmock GTest::gtest_main)
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES TIMEOUT ${ARG_TIMEOUT})
  ll_label_test(${name} ${ARG_LABELS})
  foreach(label onboard threads)
    if(label IN_LIST ARG_LABELS)
      add_dependencies(${label}_tests ${name})
    endif()
  endforeach()
  if(ARG_SERIAL)
    set_tests_properties(${name} PROPERTIES RUN_SERIAL ON)
  endif()
endfunction()

# ll_namespaced_test(NAME SOURCES a_test.cpp PROGRAMS program ... DEPS ... [LABELS ...]): a GoogleTest program with a main of its own that
# takes the paths of the programs. Each run gets its own /dev/shm, /tmp and loopback (RouDi is one per machine, and so are a
# drone's addresses), which needs root.
function(ll_namespaced_test name)
  cmake_parse_arguments(ARG "" "" "SOURCES;PROGRAMS;DEPS;LABELS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE ledgerline_options GTest::gtest ${ARG_DEPS})
  add_dependencies(${name} ${ARG_PROGRAMS})
  set(paths)
  foreach(program ${ARG_PROGRAMS})
    list(APPEND paths $<TARGET_FILE:${program}>)
  endforeach()
  add_test(NAME ${name} COMMAND ${CMAKE_SOURCE_DIR}/tests/unit/in_namespace.sh $<TARGET_FILE:${name}> ${paths})
  set_tests_properties(${name} PROPERTIES TIMEOUT 120 SKIP_RETURN_CODE 77)
  ll_label_test(${name} ${ARG_LABELS})
endfunction()

# page_as_text(NAME FILE NAMESPACE): an HTML page with the pages' style and helpers in it, as the text NAMESPACE::NAME; its source is
# ${CMAKE_CURRENT_BINARY_DIR}/NAME.cpp.
function(page_as_text PAGE_NAME PAGE_FILE PAGE_NAMESPACE)
  set(style ${CMAKE_SOURCE_DIR}/common/page/style.css)
  set(helpers ${CMAKE_SOURCE_DIR}/common/page/helpers.js)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${style} ${helpers} ${CMAKE_CURRENT_SOURCE_DIR}/${PAGE_FILE})
  file(READ ${style} STYLE)
  file(READ ${helpers} HELPERS)
  file(READ ${CMAKE_CURRENT_SOURCE_DIR}/${PAGE_FILE} PAGE)
  string(REPLACE "@STYLE@" "${STYLE}" PAGE "${PAGE}")
  string(REPLACE "@HELPERS@" "${HELPERS}" PAGE "${PAGE}")
  configure_file(${CMAKE_SOURCE_DIR}/common/page/page_template.cpp.in ${CMAKE_CURRENT_BINARY_DIR}/${PAGE_NAME}.cpp @ONLY)
endfunction()
