# Fuzzers of the file readers and of the node's message handlers: -DCATNAV_FUZZ=ON with clang as the C compiler;
# scripts/fuzz.sh builds and runs them.
add_compile_options(-g -O1 -fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=undefined)
# kernels in GCC's vectors, which clang lacks, go in as GCC makes them
file(GLOB KERNEL_HEADERS CONFIGURE_DEPENDS include/catnav/*.h src/core/*.h)
foreach(name body_kernel body_tet10_kernel body_wall_kernel molecules_kernel rod_kernel solve_ladder)
  set(source ${PROJECT_SOURCE_DIR}/src/core/${name}.c)
  list(REMOVE_ITEM CORE_SOURCES ${source})
  add_custom_command(OUTPUT ${name}.o DEPENDS ${source} ${KERNEL_HEADERS}
    COMMAND gcc -std=c11 -O2 -fPIC -ffp-contract=off -D_POSIX_C_SOURCE=200809L -I${PROJECT_SOURCE_DIR}/include
      -I${CHOLMOD_INCLUDE_DIR} -c ${source} -o ${name}.o)
  list(APPEND CORE_SOURCES ${PROJECT_BINARY_DIR}/${name}.o)
endforeach()
add_library(${PROJECT_NAME}_readers STATIC ${CORE_SOURCES})
target_include_directories(${PROJECT_NAME}_readers PUBLIC include PRIVATE src/core ${CHOLMOD_INCLUDE_DIR})
target_compile_definitions(${PROJECT_NAME}_readers PRIVATE _POSIX_C_SOURCE=200809L CATNAV_VERSION="${PROJECT_VERSION}"
  CN_WORLD_CELLS=50000)
target_link_libraries(${PROJECT_NAME}_readers PUBLIC ${CHOLMOD_LIBRARY} ${SUITESPARSE_CONFIG_LIBRARY} ${YAML_LIBRARY}
  ${JANSSON_LIBRARY} Threads::Threads m)
file(GLOB NODE_SOURCES CONFIGURE_DEPENDS src/ros/node*.c)
add_library(${PROJECT_NAME}_fake_node STATIC ${NODE_SOURCES} test/node/fake_ros.c)
target_include_directories(${PROJECT_NAME}_fake_node PUBLIC src/ros test/node)
target_compile_definitions(${PROJECT_NAME}_fake_node PUBLIC _GNU_SOURCE PRIVATE CATNAV_VERSION="${PROJECT_VERSION}")
target_link_libraries(${PROJECT_NAME}_fake_node PUBLIC ${PROJECT_NAME}_readers)
file(GLOB FUZZERS CONFIGURE_DEPENDS test/fuzz/fuzz_*.c)
foreach(source ${FUZZERS})
  get_filename_component(name ${source} NAME_WE)
  add_executable(${name} ${source})
  target_include_directories(${name} PRIVATE src/core)
  target_link_libraries(${name} PRIVATE ${PROJECT_NAME}_fake_node)
  target_link_options(${name} PRIVATE -fsanitize=fuzzer,address,undefined)
endforeach()
