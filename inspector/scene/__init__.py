"""The 3D view: conversion of arrays to viser nodes."""
