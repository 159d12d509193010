# find_package(palpate) for the folder that this file is in: palpate::palpate (shared), palpate::static, and palpate::cpp, which adds the
# C++ header's requirement of C++17 to the shared one.
get_filename_component(_palpate_root "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)

if(NOT TARGET palpate::palpate)
  find_package(Threads REQUIRED)
  add_library(palpate::palpate SHARED IMPORTED)
  set_target_properties(palpate::palpate PROPERTIES
    IMPORTED_LOCATION "${_palpate_root}/lib/libpalpate.so"
    INTERFACE_INCLUDE_DIRECTORIES "${_palpate_root}/include")
  if(NOT EXISTS "${_palpate_root}/lib/libpalpate.so.@ABI@")
    set_target_properties(palpate::palpate PROPERTIES IMPORTED_NO_SONAME TRUE)
  else()
    set_target_properties(palpate::palpate PROPERTIES IMPORTED_SONAME "libpalpate.so.@ABI@")
  endif()

  add_library(palpate::static STATIC IMPORTED)
  set_target_properties(palpate::static PROPERTIES
    IMPORTED_LOCATION "${_palpate_root}/lib/libpalpate.a"
    INTERFACE_INCLUDE_DIRECTORIES "${_palpate_root}/include"
    INTERFACE_LINK_LIBRARIES "Threads::Threads;${CMAKE_DL_LIBS};m")

  add_library(palpate::cpp INTERFACE IMPORTED)
  set_target_properties(palpate::cpp PROPERTIES
    INTERFACE_LINK_LIBRARIES palpate::palpate
    INTERFACE_COMPILE_FEATURES cxx_std_17)
endif()

set(palpate_VERSION "@VERSION@")
set(palpate_ABI_VERSION "@ABI@")
unset(_palpate_root)
