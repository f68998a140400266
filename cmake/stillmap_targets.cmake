# Warnings, sanitizers and the shape that every target of ours shares.
add_library(stillmap_flags INTERFACE)
target_compile_options(stillmap_flags INTERFACE -Wall -Wextra -Wconversion -Wshadow -Wpedantic -Werror
  # GCC 12 sees overlapping copies in std::string's operator+ at -O3 (GCC bug 105651).
  $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
  # The compiler's own garbage collection costs a sixth of its time and spares a tenth of its memory.
  "$<$<CXX_COMPILER_ID:GNU>:SHELL:--param ggc-min-heapsize=1048576 --param ggc-min-expand=200>"
  # Equal bits for equal input: no fused multiply-add that depends on the compiler's mood.
  -ffp-contract=off
  # With GCC 12 and -O2, this pass made poses depend on which files are compiled together, by up to 4 mm.
  $<$<CXX_COMPILER_ID:GNU>:-fno-tree-slp-vectorize>
  # Clang's takes names of files that are compiled together for one scope's; GCC's does not.
  $<$<CXX_COMPILER_ID:Clang>:-Wno-shadow>)
# With SSE 4.2 (Intel since 2008, its Atoms and AMD since 2013) rounding is an instruction, not a call. Robots' small
# computers may lack AVX, so more than that is chosen at run time (Highway).
if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64)$")
  target_compile_options(stillmap_flags INTERFACE -march=x86-64-v2)
endif()
if(STILLMAP_SANITIZE)
  target_compile_options(stillmap_flags INTERFACE -fsanitize=${STILLMAP_SANITIZE} -fno-sanitize-recover=all
    -fno-omit-frame-pointer)
  target_link_options(stillmap_flags INTERFACE -fsanitize=${STILLMAP_SANITIZE})
endif()

# stillmap_unity(TARGET): the files of a folder are compiled together, so that their headers are parsed once; small
# folders with their neighbours, large ones in parts. What has compile options of its own is compiled alone. CMake's own
# unity builds name the files by absolute paths; these do not, so that ccache knows them in any clone.
option(STILLMAP_UNITY "Compile the files of a folder together" ON)
set(STILLMAP_UNITY_KB 200 CACHE STRING "How much source is compiled together [kB]")
function(stillmap_unity target)
  if(STILLMAP_UNITY) # when all options are known
    cmake_language(EVAL CODE "cmake_language(DEFER CALL stillmap_compile_together ${target})")
  endif()
endfunction()

function(stillmap_compile_together target)
  get_target_property(sources ${target} SOURCES)
  set(compiled ${sources})
  list(FILTER compiled EXCLUDE REGEX "\\.cpp$")
  list(FILTER sources INCLUDE REGEX "\\.cpp$")
  list(SORT sources)
  set(folders "")
  foreach(source IN LISTS sources)
    cmake_path(ABSOLUTE_PATH source)
    get_filename_component(folder ${source} DIRECTORY)
    file(SIZE ${source} bytes)
    list(APPEND folders ${folder})
    list(APPEND files_${folder} ${source})
    math(EXPR bytes_${folder} "0${bytes_${folder}} + ${bytes}")
  endforeach()
  list(REMOVE_DUPLICATES folders)
  set(numbers "")
  math(EXPR most "1000 * ${STILLMAP_UNITY_KB}")
  set(group 0)
  set(filled 0)
  foreach(folder IN LISTS folders)
    math(EXPR together "${filled} + ${bytes_${folder}}")
    if(together GREATER most)
      math(EXPR group "${group} + 1")
      set(together ${bytes_${folder}})
    endif()
    set(filled ${together})
    list(LENGTH files_${folder} count)
    math(EXPR parts "(${bytes_${folder}} + ${most} - 1) / ${most}")
    math(EXPR in_part "(${count} + ${parts} - 1) / ${parts}")
    set(index 0)
    foreach(source IN LISTS files_${folder})
      # Highway compiles such a file once more for each instruction set, by itself; a pragma is for its own file.
      file(STRINGS ${source} alone REGEX "hwy/foreach_target.h|^#pragma GCC")
      get_source_file_property(options ${source} COMPILE_OPTIONS)
      get_source_file_property(definitions ${source} COMPILE_DEFINITIONS)
      if(alone OR options OR definitions)
        list(APPEND compiled ${source})
        continue()
      endif()
      math(EXPR part "${group} + ${index} / ${in_part}")
      file(RELATIVE_PATH from_part ${CMAKE_CURRENT_BINARY_DIR}/${target}_unity ${source})
      list(APPEND numbers ${part})
      string(APPEND part_${part} "#include \"${from_part}\"\n")
      math(EXPR index "${index} + 1")
    endforeach()
    math(EXPR group "${group} + ${parts} - 1")
  endforeach()
  list(REMOVE_DUPLICATES numbers)
  foreach(part IN LISTS numbers)
    set(together ${CMAKE_CURRENT_BINARY_DIR}/${target}_unity/${part}.cpp)
    file(CONFIGURE OUTPUT ${together} CONTENT "${part_${part}}" @ONLY)
    list(APPEND compiled ${together})
  endforeach()
  set_target_properties(${target} PROPERTIES SOURCES "${compiled}")
endfunction()

# stillmap_fast(TARGET): at -O3, for code whose loops users wait for.
function(stillmap_fast target)
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O3>)
endfunction()

# stillmap_for_module(TARGET): a library that the Python package's module links, too. With hidden names, calls within it
# stay direct, and position independent code is as fast as that of programs.
function(stillmap_for_module target)
  set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE ON CXX_VISIBILITY_PRESET hidden)
endfunction()

# stillmap_library(NAME): sources in src/, public headers in include/ and nothing else reachable from outside.
function(stillmap_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES" ${ARGN})
  add_library(${name} STATIC ${ARG_SOURCES})
  target_include_directories(${name} PUBLIC ${CMAKE_CURRENT_SOURCE_DIR}/include
    PRIVATE ${CMAKE_CURRENT_SOURCE_DIR}/src)
  target_link_libraries(${name} PRIVATE $<BUILD_INTERFACE:stillmap_flags>)
  stillmap_unity(${name})
endfunction()

# stillmap_test(NAME SOURCES ... LIBRARIES ... LABEL ... [PRIVATE_OF folder] [TIMEOUT seconds]): one GoogleTest program,
# a test of CTest for each of its suites. PRIVATE_OF lets unit tests reach the private headers of the folder they test.
function(stillmap_test name)
  cmake_parse_arguments(ARG "" "PRIVATE_OF;TIMEOUT" "SOURCES;LIBRARIES;LABEL" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
  if(ARG_PRIVATE_OF)
    target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/${ARG_PRIVATE_OF}/src)
  endif()
  target_link_libraries(${name} PRIVATE stillmap_flags)
  target_link_libraries(${name} PRIVATE ${ARG_LIBRARIES} GTest::gmock GTest::gtest_main)
  stillmap_unity(${name})
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
