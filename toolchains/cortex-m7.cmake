# Bare Cortex-M7 with double-precision FPU (STM32F7, and QEMU's mps2-an500).
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR cortex-m7)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_CXX_COMPILER arm-none-eabi-g++)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(IVFM_CPU_FLAGS -mcpu=cortex-m7 -mthumb -mfpu=fpv5-d16 -mfloat-abi=hard)
add_compile_options(${IVFM_CPU_FLAGS} -ffunction-sections -fdata-sections -Wno-psabi)
# Images link with -nostdlib: memcpy and the like, and 64-bit divisions, but no start-up and no heap.
set(CMAKE_CXX_STANDARD_LIBRARIES "-lc -lgcc")
