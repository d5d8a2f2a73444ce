// LD_PRELOAD: reads of files whose path contains FAIL_UNDER fail with EIO: the FAIL_AT-th of each process, or with FAIL_AT=0 all.
// With FLIP_ONCE, a path, the first process that reads HDF5 for others returns wrong bytes instead; it creates this file.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
static long count;
static int under(int fd){char l[64],p[600],*u=getenv("FAIL_UNDER");snprintf(l,64,"/proc/self/fd/%d",fd);
 ssize_t n=readlink(l,p,599);p[n<0?0:n]=0;return u&&strstr(p,u);}
static int fails(int fd){char *a=getenv("FAIL_AT");if(!a||!under(fd))return 0;
 return atol(a)==0||__sync_add_and_fetch(&count,1)==atol(a);}
static int flips(int fd){static int first=-1;char c[600],*f=getenv("FLIP_ONCE");if(!f||!under(fd))return 0;
 if(first<0){first=0;int d=open("/proc/self/cmdline",O_RDONLY);ssize_t n=read(d,c,600);close(d);
  if(n>0&&memmem(c,n,"read-hdf5",9))first=open(f,O_CREAT|O_EXCL|O_WRONLY,0600)>=0;}
 return first;}
#define WRAP(name,args,call) ssize_t name args{static ssize_t(*f)args;if(!f)f=dlsym(RTLD_NEXT,#name);if(fails(fd)){errno=EIO;return -1;}\
 ssize_t r=f call;if(r>0&&flips(fd))((char*)b)[r/2]^=1;return r;}
WRAP(read,(int fd,void*b,size_t n),(fd,b,n))
WRAP(pread,(int fd,void*b,size_t n,off_t o),(fd,b,n,o))
WRAP(pread64,(int fd,void*b,size_t n,off64_t o),(fd,b,n,o))
