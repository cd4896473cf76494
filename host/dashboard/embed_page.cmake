# Writes page_files.h: the page's files as strings. Included by CMakeLists.txt.
set(page_folder ${CMAKE_CURRENT_SOURCE_DIR}/page)
set(page_files_h "// Generated from host/dashboard/page/ by embed_page.cmake.\n#pragma once\n\n")
string(APPEND page_files_h "#include <array>\n#include <string_view>\n\nnamespace ivfm::host {\n\n")
function(embed_text name file)
  file(READ ${page_folder}/${file} text)
  string(APPEND page_files_h
         "inline constexpr std::string_view ${name} = R\"ivfm(${text})ivfm\";\n")
  set(page_files_h "${page_files_h}" PARENT_SCOPE)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${page_folder}/${file})
endfunction()
embed_text(kPageHtml index.html)
embed_text(kPageCss page.css)
string(APPEND page_files_h
       "struct PageScript {\n  const char* path;\n  std::string_view text;\n};\n")
set(page_script_rows "")
set(page_script_count 0)
foreach(script charts.js colours.js local_pictures.js map_view.js page.js run_model.js)
  string(REPLACE ".js" "" name ${script})
  embed_text(script_${name} ${script})
  string(APPEND page_script_rows "    PageScript{\"/${script}\", script_${name}},\n")
  math(EXPR page_script_count "${page_script_count} + 1")
endforeach()
string(APPEND page_files_h
       "inline constexpr std::array<PageScript, ${page_script_count}> kPageScripts{\n"
       "${page_script_rows}};\n\n}  // namespace ivfm::host\n")
# Written only when it differs, so that configuring again does not build again.
file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/page_files.h.new "${page_files_h}")
configure_file(${CMAKE_CURRENT_BINARY_DIR}/page_files.h.new
               ${CMAKE_CURRENT_BINARY_DIR}/include/host/dashboard/page_files.h COPYONLY)
