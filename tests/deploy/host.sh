#!/bin/sh
# A systemd of its own in new namespaces: host.sh WORK PREFIX. Only WORK and these copies are written.
set -eu
work=$1 prefix=$2
mount --make-rprivate /
mkdir -p "$work/etc" "$work/opt/softarm" "$work/lib" "$work/cache"
cp -a /etc/. "$work/etc/"
rm -rf "$work/etc/systemd/system" && mkdir -p "$work/etc/systemd/system"
mount --bind "$work/etc" /etc
mount --bind "$work/opt" /opt
mount --bind "$prefix" /opt/softarm
mount --bind "$work/lib" /var/lib
mount --bind "$work/cache" /var/cache
mount -t tmpfs tmpfs /run
mkdir -p /run/systemd/system /run/lock
printf '[Unit]\nDefaultDependencies=no\n' >/run/systemd/system/test.target
ln -s /dev/null /run/systemd/system/network-online.target
export container=unshare
exec /lib/systemd/systemd --system --unit=test.target --show-status=0 --log-target=console
