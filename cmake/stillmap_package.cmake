# The Debian package: `cpack -G DEB` in the build folder. What only a package may install (folders outside the prefix)
# is a component that `cmake --install` leaves out.
set(STILLMAP_PACKAGE_MAINTAINER "stillmap maintainers <maintainers@stillmap.invalid>" CACHE STRING
  "Who answers for the Debian package, as Name <address>")
set(deploy ${PROJECT_SOURCE_DIR}/server/deploy)
set(package ${PROJECT_BINARY_DIR}/package)
configure_file(${deploy}/package/changelog.in ${package}/changelog @ONLY)

# gzip_into(FILE NAME): packed without time and name, so that equal sources give equal packages.
function(gzip_into file name)
  add_custom_command(OUTPUT ${package}/${name} COMMAND gzip -9nc ${file} > ${package}/${name} DEPENDS ${file} VERBATIM)
  set_property(GLOBAL APPEND PROPERTY stillmap_packed ${package}/${name})
endfunction()
gzip_into(${PROJECT_SOURCE_DIR}/CHANGELOG.md changelog.gz)
gzip_into(${package}/changelog changelog.Debian.gz)
gzip_into(${deploy}/package/stillmap.1 stillmap.1.gz)
get_property(packed GLOBAL PROPERTY stillmap_packed)
add_custom_target(package_texts ALL DEPENDS ${packed})

set(only_packages COMPONENT debian EXCLUDE_FROM_ALL)
install(FILES ${deploy}/stillmap.json DESTINATION /etc/stillmap PERMISSIONS OWNER_READ OWNER_WRITE GROUP_READ WORLD_READ
  ${only_packages})
install(FILES ${deploy}/systemd/stillmap.service ${deploy}/systemd/stillmap-backup.service
  ${deploy}/systemd/stillmap-backup.timer DESTINATION /lib/systemd/system ${only_packages})
install(FILES ${deploy}/package/sysusers.conf DESTINATION lib/sysusers.d RENAME stillmap.conf ${only_packages})
install(FILES ${package}/stillmap.1.gz DESTINATION share/man/man1 ${only_packages})
install(FILES ${deploy}/package/copyright ${package}/changelog.gz ${package}/changelog.Debian.gz
  ${PROJECT_SOURCE_DIR}/THIRD_PARTY.md DESTINATION share/doc/stillmap ${only_packages})
# As they lie in the repository, so that the links between them hold.
foreach(folder server server/clients server/decisions server/deploy server/docs)
  file(GLOB pages CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/${folder}/*.md)
  install(FILES ${pages} DESTINATION share/doc/stillmap/${folder} ${only_packages})
endforeach()
install(DIRECTORY ${deploy}/proxy ${deploy}/monitoring ${deploy}/containers DESTINATION share/doc/stillmap/server/deploy
  ${only_packages})
install(FILES ${PROJECT_SOURCE_DIR}/server/docs/sizing.py DESTINATION share/doc/stillmap/server/docs ${only_packages})

set(CPACK_PACKAGE_NAME stillmap)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_CONTACT "${STILLMAP_PACKAGE_MAINTAINER}")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "maps of what stays from LiDAR drives, and a server that localizes in them")
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION
"Turns LiDAR drives into maps without the objects that move or are parked,
and answers where a scan was taken, over HTTP. Holds the program stillmap,
the mapper that it starts, the web page and a systemd service.")
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_THREADS 0)
set(CPACK_COMPONENTS_ALL Unspecified debian)
set(CPACK_COMPONENTS_GROUPING ALL_COMPONENTS_IN_ONE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
# postinst calls systemd-sysusers.
set(CPACK_DEBIAN_PACKAGE_DEPENDS "systemd | systemd-standalone-sysusers | systemd-sysusers")
# Loaded where blobs are in S3.
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "libcurl4 (>= 7.85)")
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA ${deploy}/package/postinst ${deploy}/package/prerm ${deploy}/package/postrm
  ${deploy}/package/conffiles)
include(CPack)
