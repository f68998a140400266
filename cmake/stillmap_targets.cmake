# Warnings, sanitizers and the shape that every target of ours shares.
add_library(stillmap_flags INTERFACE)
target_compile_options(stillmap_flags INTERFACE -Wall -Wextra -Wconversion -Wshadow -Wpedantic -Werror
  # GCC 12 sees overlapping copies in std::string's operator+ at -O3 (GCC bug 105651).
  $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
  # The compiler's own garbage collection costs a sixth of its time and spares a tenth of its memory.
  "$<$<CXX_COMPILER_ID:GNU>:SHELL:--param ggc-min-heapsize=1048576 --param ggc-min-expand=200>"
  # Equal bits for equal input: no fused multiply-add that depends on the compiler's mood.
  -ffp-contract=off)
if(STILLMAP_SANITIZE)
  target_compile_options(stillmap_flags INTERFACE -fsanitize=${STILLMAP_SANITIZE} -fno-sanitize-recover=all
    -fno-omit-frame-pointer)
  target_link_options(stillmap_flags INTERFACE -fsanitize=${STILLMAP_SANITIZE})
endif()

# GCC 12 no longer takes precompiled system headers for the system's, and finds more of bug 105651 in them.
add_library(stillmap_precompiled INTERFACE)
if(NOT CMAKE_DISABLE_PRECOMPILE_HEADERS)
  target_compile_options(stillmap_precompiled INTERFACE
    "$<$<CXX_COMPILER_ID:GNU>:-Wno-stringop-overflow;-Wno-stringop-overread;-Wno-array-bounds>")
endif()

# stillmap_precompile(TARGET [HEADER...]): what nearly every file of it includes is parsed once. The preset `dev` does
# without, and so shows which file does not include what it uses.
function(stillmap_precompile target)
  target_precompile_headers(${target} PRIVATE <algorithm> <array> <atomic> <bit> <chrono> <cmath> <cstddef> <cstdint>
    <cstring> <exception> <filesystem> <fstream> <functional> <limits> <map> <memory> <mutex> <numbers> <numeric> <optional>
    <random> <set> <span> <sstream> <stdexcept> <string> <string_view> <system_error> <thread> <tuple> <unordered_map>
    <utility> <variant> <vector> <Eigen/Geometry> ${ARGN})
  target_link_libraries(${target} PRIVATE $<BUILD_INTERFACE:stillmap_precompiled>)
endfunction()

# stillmap_library(NAME): sources in src/, public headers in include/ and nothing else reachable from outside.
function(stillmap_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES" ${ARGN})
  add_library(${name} STATIC ${ARG_SOURCES})
  target_include_directories(${name} PUBLIC ${CMAKE_CURRENT_SOURCE_DIR}/include
    PRIVATE ${CMAKE_CURRENT_SOURCE_DIR}/src)
  target_link_libraries(${name} PRIVATE $<BUILD_INTERFACE:stillmap_flags>)
  stillmap_precompile(${name} <fmt/format.h>)
endfunction()

# stillmap_test(NAME SOURCES ... LIBRARIES ... LABEL ... [PRIVATE_OF folder] [TIMEOUT seconds]): one GoogleTest program,
# a test of CTest for each of its suites. PRIVATE_OF lets unit tests reach the private headers of the folder they test.
function(stillmap_test name)
  cmake_parse_arguments(ARG "" "LABEL;PRIVATE_OF;TIMEOUT" "SOURCES;LIBRARIES" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
  if(ARG_PRIVATE_OF)
    target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/${ARG_PRIVATE_OF}/src)
  endif()
  target_link_libraries(${name} PRIVATE stillmap_flags)
  list(LENGTH ARG_SOURCES files)
  if(files GREATER 8) # not worth it for few files
    stillmap_precompile(${name} <gmock/gmock.h> <gtest/gtest.h>)
  endif()
  target_link_libraries(${name} PRIVATE ${ARG_LIBRARIES} GTest::gmock GTest::gtest_main)
  # What is tested keeps its optimisation; the tests themselves are compiled more often than their loops are long.
  target_compile_options(${name} PRIVATE -O1)
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 600) # the longest suite takes 12 s, sanitizers some 30 times that
  endif()
  set(suites ${CMAKE_CURRENT_BINARY_DIR}/${name}_suites.cmake)
  set(script ${PROJECT_SOURCE_DIR}/cmake/GTestSuites.cmake)
  set_property(TARGET ${name} APPEND PROPERTY LINK_DEPENDS ${script})
  add_custom_command(TARGET ${name} POST_BUILD BYPRODUCTS ${suites} VERBATIM
    COMMAND ${CMAKE_COMMAND} -D PROGRAM=$<TARGET_FILE:${name}> -D FILE=${suites} -D "LABELS=fast;${ARG_LABEL}"
      -D TIMEOUT=${ARG_TIMEOUT} -P ${script})
  # CTest stops at a file that is not there; what was not built is a test that fails.
  file(GENERATE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/${name}_include.cmake CONTENT "if(EXISTS [==[${suites}]==])
  include([==[${suites}]==])
else()
  add_test(${name}_NOT_BUILT ${name}_NOT_BUILT)
  set_tests_properties(${name}_NOT_BUILT PROPERTIES LABELS [==[fast;${ARG_LABEL}]==])
endif()
")
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${CMAKE_CURRENT_BINARY_DIR}/${name}_include.cmake)
endfunction()
