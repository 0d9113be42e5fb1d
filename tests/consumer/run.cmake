# SPDX-License-Identifier: Apache-2.0
# cmake -DBUILD=… -DSOURCE=… -DGENERATOR=… -DCOMPILER=… -DWORK=… -P run.cmake
# Installs a build to a fresh prefix, then configures, builds and runs the consumers, in C++ and in C, against it.
foreach(needed BUILD SOURCE GENERATOR COMPILER WORK)
  if(NOT DEFINED ${needed})
    message(FATAL_ERROR "run.cmake needs -D${needed}=…")
  endif()
endforeach()

file(REMOVE_RECURSE ${WORK})
function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "'${ARGN}' failed (${result}):\n${output}")
  endif()
  set(output "${output}" PARENT_SCOPE)
endfunction()

run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/prefix)
foreach(folder . c)
  run(${CMAKE_COMMAND} -S ${SOURCE}/${folder} -B ${WORK}/build/${folder} -G ${GENERATOR}
    -DCMAKE_CXX_COMPILER=${COMPILER} -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH=${WORK}/prefix)
  run(${CMAKE_COMMAND} --build ${WORK}/build/${folder})
endforeach()
run(${WORK}/build/consumer)
message(STATUS "${output}")
run(${WORK}/build/train)
message(STATUS "${output}")
run(${WORK}/build/c/c_consumer)
message(STATUS "${output}")
