# The page's files are built into ground, so that it needs no folder and no network: ledgerline_station_page. Its libraries come from npm
# (ground/page/lib/package.json, installed where LEDGERLINE_PAGE_NPM says); ledgerline_plain_station_page is the page without them.
set(LEDGERLINE_PAGE_NPM ${CMAKE_SOURCE_DIR}/build/npm-station CACHE PATH "Where what ground/page/lib/package.json names is installed")
set(page ${CMAKE_SOURCE_DIR}/ground/page)
file(GLOB page_files CONFIGURE_DEPENDS RELATIVE ${page} ${page}/*.html ${page}/*.js ${page}/*.css ${page}/faults/*.js ${page}/look/*.js ${page}/missions/*.js ${page}/operators/*.js)
list(TRANSFORM page_files REPLACE "^.+$" "\\0=${page}/\\0" OUTPUT_VARIABLE plain_page)

set(page_libraries ${plain_page})
file(GLOB installed_lock CONFIGURE_DEPENDS ${LEDGERLINE_PAGE_NPM}/package-lock.json)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${page}/lib/package-lock.json)
set(lacking "nothing is installed in ${LEDGERLINE_PAGE_NPM}")
if(installed_lock)
  file(SHA256 ${installed_lock} installed)
  file(SHA256 ${page}/lib/package-lock.json wanted)
  set(lacking "")
  if(NOT installed STREQUAL wanted)
    set(lacking "other versions are installed in ${LEDGERLINE_PAGE_NPM}")
  endif()
endif()
if(lacking)
  message(STATUS "The page is built without its 3-D view and charts: ${lacking}; copy ground/page/lib/package*.json there and run npm ci")
else()
  set(modules ${LEDGERLINE_PAGE_NPM}/node_modules)
  list(APPEND page_libraries lib/three.module.js=${modules}/three/build/three.module.js lib/three.core.js=${modules}/three/build/three.core.js
    lib/OrbitControls.js=${modules}/three/examples/jsm/controls/OrbitControls.js lib/three-LICENSE.txt=${modules}/three/LICENSE
    lib/uPlot.esm.js=${modules}/uplot/dist/uPlot.esm.js lib/uPlot.min.css=${modules}/uplot/dist/uPlot.min.css
    lib/uPlot-LICENSE.txt=${modules}/uplot/LICENSE)
endif()

function(ll_page name)
  set(files ${ARGN})
  list(TRANSFORM files REPLACE "^[^=]*=" "")
  add_custom_command(OUTPUT ${name}.cpp
    COMMAND ${Python3_EXECUTABLE} ${CMAKE_SOURCE_DIR}/cmake/embed_files.py ${CMAKE_CURRENT_BINARY_DIR}/${name}.cpp ${ARGN}
    DEPENDS ${files} ${CMAKE_SOURCE_DIR}/cmake/embed_files.py VERBATIM)
  ll_library(${name} SOURCES ${CMAKE_CURRENT_BINARY_DIR}/${name}.cpp)
  set(with 0)
  if("${ARGN}" MATCHES ";lib/")
    set(with 1)
  endif()
  target_compile_definitions(${name} INTERFACE LEDGERLINE_PAGE_LIBRARIES=${with})
endfunction()
find_package(Python3 REQUIRED COMPONENTS Interpreter)
ll_page(ledgerline_station_page ${page_libraries})
ll_page(ledgerline_plain_station_page ${plain_page})
